"""Similarity transforms and reprojection reports against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from studio.calibration import align_points, align_rigs, compare_rigs, reprojection_report
from studio.calibration.alignment import Similarity, floor_world, scale_to_distance, upright
from studio.cameras import Camera, Rig
from tests.support import rigs
from tests.support.errors import refuses

RANDOM = np.random.default_rng(4)


def turn(axis: list[float], angle: float) -> np.ndarray:
    """Rotation about an axis (Rodrigues)."""
    a = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def ring(count: int = 6, radius: float = 4.0, target: tuple[float, float, float] = (0, 0, 0)) -> Rig:
    intrinsics = {"focal": 500.0, "size": (640, 480), "distortion": (-0.1, 0.02, 0, 0)}
    return rigs.ring(count, radius=radius, target=target, name="c{}", **intrinsics)


MOVE = Similarity(2.5, turn([1, 2, 3], 1.1), np.array([3.0, -4.0, 5.0]))


def test_moving_a_rig_changes_no_image() -> None:
    rig, points = ring(), RANDOM.uniform(-1, 1, (30, 3))
    moved = MOVE.rig(rig)
    for camera in rig:
        pixels, depth = camera.project(points)
        pixels_moved, depth_moved = moved[camera.name].project(MOVE.points(points))
        np.testing.assert_allclose(pixels_moved, pixels, atol=1e-8)
        np.testing.assert_allclose(depth_moved, 2.5 * depth, atol=1e-9)


def test_alignment_finds_the_move() -> None:
    points = RANDOM.normal(size=(20, 3))
    found = align_points(points, MOVE.points(points))
    assert found.scale == pytest.approx(2.5)
    np.testing.assert_allclose(found.rotation, MOVE.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, MOVE.translation, atol=1e-12)
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
    assert difference.rotations["c3"] == pytest.approx(0.5, abs=1e-6)
    assert difference.rotation_degrees == pytest.approx(0.5, abs=1e-6)
    assert difference.radius == pytest.approx(4.0)
    assert difference.center_percent < 1e-6


def test_upright_world() -> None:
    """For any initial world: z up, origin where the cameras look, x toward the first camera, mean distance 1."""
    rig = MOVE.rig(ring(5, 4.0, (0.3, 0.2, 0.1)))
    world = upright(rig, np.zeros((0, 3))).rig(rig)
    np.testing.assert_allclose(world.up, [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(world.focus, 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(world.centers, axis=1), 1, atol=1e-9)
    np.testing.assert_allclose(world.cameras[0].center, [1, 0, 0], atol=1e-9)


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
    with refuses("calibration.distance", value=0.0):
        scale_to_distance(rig, "c0", "c3", 0.0)
    with refuses("camera.unknown", value="x"):
        scale_to_distance(rig, "c0", "x", 1.0)


def test_too_few_cameras_to_align() -> None:
    with refuses("calibration.too_few_points", value=2, expected=3):
        align_rigs(ring().subset(["c0", "c1"]), ring())


def test_report_measures_errors_put_in() -> None:
    rig, points = ring(4), RANDOM.uniform(-1, 1, (50, 3))
    observations = {}
    for camera in rig:
        pixels, _ = camera.project(points)
        shift = 0.3 if camera.name == "c1" else 0.0
        observations[camera.name] = np.column_stack([np.arange(50), pixels + np.array([shift, 0])])
    report = reprojection_report(rig, points, observations)
    assert report.cameras["c1"].mean == pytest.approx(0.3, abs=1e-4)
    assert report.cameras["c0"].mean == pytest.approx(0.0, abs=1e-4)
    assert report.reprojection.mean == pytest.approx(0.075, abs=1e-4)
    assert report.reprojection.median == pytest.approx(0.0, abs=1e-4)
    assert report.reprojection.p95 == pytest.approx(0.3, abs=1e-4)
    assert (report.points, report.observations, report.mean_track_length) == (50, 200, 4.0)


@pytest.mark.parametrize("seed", range(8))
def test_a_floor_tilted_about_any_axis_becomes_level(seed: int) -> None:
    """Any tilt up to 20 degrees, any heading of its axis, any height; above the floor is noise."""
    rng = np.random.default_rng(seed)
    heading, tilt, height = rng.uniform(0, 2 * np.pi), rng.uniform(2, 20), rng.uniform(-2, 2)
    tilted = Similarity(
        1.0, turn([np.cos(heading), np.sin(heading), 0], np.radians(tilt)), np.array([0.3, -0.2, height])
    )
    floor = np.column_stack([rng.uniform(-1, 1, (300, 2)), rng.normal(0, 1e-4, 300)])
    above = rng.uniform([-0.5, -0.5, 0.05], [0.5, 0.5, 1.2], (200, 3))
    cameras = rigs.ring(6, radius=3.0, heights=(0.5,), target=(0, 0, 1), name="c{}")
    points, rig = tilted.points(np.vstack([floor, above])), tilted.rig(cameras)
    found, report = floor_world(rig, points)
    np.testing.assert_allclose(found.points(points)[:300, 2], 0, atol=2e-3)
    assert found.points(points)[300:, 2].min() > 0.04
    assert report.tilt == pytest.approx(tilt, abs=0.1)
    assert found.scale == 1.0
    assert found.rig(rig).centers[:, 2].min() > 1
