"""Refined cameras: a rig that is off by known amounts."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.studio.training.test_group import ball, cameras, views
from v3studio.studio.calibration import align_rigs
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.gaussians import SH_C0
from v3studio.studio.similarity import Similarity
from v3studio.studio.training import Correction, RefinedCameras, TrainingView, TrainSettings, refine_cameras

SETTINGS = TrainSettings(keyframe_iterations=140, dropout=0.0, opacity_reg=0.0, scale_reg=0.0)
HELD_OUT = 3


def off(camera: Camera, number: int) -> Camera:
    """A camera that is turned, moved and zoomed a little, differently for each number."""
    random = np.random.default_rng(number)
    pose, K = camera.world_to_camera.copy(), camera.K.copy()
    pose[:3] = Rotation.from_rotvec(random.normal(0, 0.006, 3)).as_matrix() @ pose[:3]
    pose[:3, 3] += random.normal(0, 0.015, 3)
    K[:2, :2] *= 1 + random.normal(0, 0.01)
    return replace(camera, world_to_camera=pose, K=K)


def refined(rig: list[Camera], seed: int = 0, settings: TrainSettings = SETTINGS) -> RefinedCameras:
    """Views of the true cameras, by cameras that say that they are elsewhere."""
    truth = ball(torch.zeros(3))
    pairs = zip(rig, views(torch.zeros(3)), strict=True)
    trained = [TrainingView(camera, one.image, one.mask) for camera, one in pairs]
    held_out, colors = [trained.pop(HELD_OUT)], truth.sh[:, 0] * SH_C0 + 0.5
    return refine_cameras(trained, truth.means, colors, settings, held_out=held_out, seed=seed)


def after(rig: list[Camera], found: RefinedCameras) -> Rig:
    corrections = list(found.corrections)
    corrections.insert(HELD_OUT, found.held_out[0])
    return Rig(tuple(one.of(camera) for camera, one in zip(rig, corrections, strict=True)))


def pixels_off(rig: Rig) -> float:
    """Mean distance in pixels between where cameras, once aligned, see the points of the ball and where they are."""
    points = ball(torch.zeros(3)).means.double().numpy()
    truth = Rig(tuple(cameras()))
    pairs = zip(align_rigs(rig, truth).rig(rig), truth, strict=True)
    return np.mean([np.linalg.norm(a.project(points)[0] - b.project(points)[0], axis=1) for a, b in pairs])


GIVEN = [off(camera, number) for number, camera in enumerate(cameras())]


def test_cameras_that_are_off_come_nearer_to_the_truth() -> None:
    found = refined(GIVEN)
    assert found.gain > 2
    assert found.held_out_after > found.held_out_before > found.held_out_calibrated
    assert pixels_off(after(GIVEN, found)) < 0.5 * pixels_off(Rig(tuple(GIVEN)))


def test_correct_cameras_stay_and_gain_little() -> None:
    found = refined(cameras())
    assert found.gain < 0.6
    assert pixels_off(after(cameras(), found)) < 0.25


def test_the_same_seed_gives_the_same_cameras_bit_for_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.training.camera_refinement.ALIGN_STEPS", 5)
    short = SETTINGS.replace(keyframe_iterations=15)
    poses = [after(GIVEN, refined(GIVEN, seed=5, settings=short)).centers for _ in range(2)]
    assert np.array_equal(*poses)


def test_a_correction_moves_the_camera_the_other_way_than_the_scene() -> None:
    camera = replace(cameras()[0], distortion=np.array([0.01, 0, 0, 0]))
    moved = Similarity(1.1, Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix(), np.array([0.1, 0.0, -0.05]))
    correction = Correction(moved, np.array([1.5, -0.5]), 0.02, 0.1)
    points = 0.4 * np.random.default_rng(0).normal(size=(50, 3))
    found, _ = correction.of(camera, larger=2.0).project(points)
    x, y, depth = (moved.points(points) @ camera.rotation.T + camera.translation).T
    slopes = np.stack([x, y], 1) / depth[:, None]
    expected = slopes * (1 + (0.11 * (slopes**2).sum(1))[:, None]) * 1.02 * camera.fx + camera.K[:2, 2] + [3.0, -1.0]
    assert np.allclose(found, expected, atol=1e-6)
