"""Similarity transforms and reprojection reports against closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support import rigs
from tests.support.errors import refuses
from v3studio.studio.calibration import align_points, align_rigs, compare_rigs
from v3studio.studio.calibration.alignment import scale_to_distance, upright
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.similarity import Similarity

RANDOM = np.random.default_rng(4)


def turn(axis: list[float], angle: float) -> np.ndarray:
    return Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis)).as_matrix()


def ring(count: int = 6) -> Rig:
    intrinsics = {"focal": 500.0, "size": (640, 480), "distortion": (-0.1, 0.02, 0, 0)}
    return rigs.ring(count, radius=4.0, name="c{}", **intrinsics)


MOVE = Similarity(2.5, turn([1, 2, 3], 1.1), np.array([3.0, -4.0, 5.0]))


def test_alignment_finds_the_move() -> None:
    points = RANDOM.normal(size=(20, 3))
    aligned = align_points(points, MOVE.points(points))
    assert aligned.scale == pytest.approx(2.5)
    np.testing.assert_allclose(aligned.rotation, MOVE.rotation, atol=1e-12)
    np.testing.assert_allclose(aligned.translation, MOVE.translation, atol=1e-12)
    # a reflection is not a rotation
    mirrored = align_points(points, points * [1, 1, -1])
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1)


def test_comparison_measures_what_was_changed() -> None:
    rig = ring(8)
    assert compare_rigs(MOVE.rig(rig), rig).center_percent < 1e-9
    assert compare_rigs(MOVE.rig(rig), rig).rotation_degrees < 1e-6
    # rotate one camera in place by half a degree
    cameras = list(rig.cameras)
    spin = Similarity(1.0, turn([1, 0, 0], np.radians(0.5)), np.zeros(3))
    center = cameras[3].center
    back = Similarity(1.0, np.eye(3), center - spin.points(center[None])[0])
    cameras[3] = back.rig(spin.rig(Rig((cameras[3],)))).cameras[0]
    difference = compare_rigs(Rig(tuple(cameras)), rig)
    assert (difference.rotations["c3"], difference.rotation_degrees) == pytest.approx((0.5, 0.5), abs=1e-6)
    assert difference.radius == pytest.approx(4.0)
    assert difference.center_percent < 1e-6


def test_upright_world_of_cameras_that_diverge() -> None:
    """If the axes meet behind the cameras, the points determine the origin."""
    cameras = []
    for x in (-1.0, 0.0, 1.0):
        rotation = turn([0, 1, 0], -0.1 * x)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ np.array([x, 0, 0])
        cameras.append(Camera(f"c{x}", 640, 480, np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1.0]]), pose))
    rig = Rig(tuple(cameras))
    points = np.array([0, 0, 6.0]) + RANDOM.normal(size=(101, 3)) * 0.1
    assert rig.focus[2] < 0
    transform = upright(rig, points)
    np.testing.assert_allclose(np.median(transform.points(points), axis=0), 0, atol=0.02)
    np.testing.assert_allclose(transform.rig(rig).up, [0, 0, 1], atol=1e-9)


def test_known_distance() -> None:
    rig = ring()
    scaled = scale_to_distance(rig, "c0", "c3", 2.0).rig(rig)
    assert np.linalg.norm(scaled["c0"].center - scaled["c3"].center) == pytest.approx(2.0)
    with refuses("camera.unknown", value="x"):
        scale_to_distance(rig, "c0", "x", 1.0)
    with refuses("calibration.too_few_points", value=2, expected=3):
        align_rigs(ring().subset(["c0", "c1"]), ring())
