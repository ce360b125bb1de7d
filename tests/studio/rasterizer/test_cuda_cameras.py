"""Cameras as the CUDA backend uploads them; needs no GPU."""

from __future__ import annotations

import numpy as np
import torch

from studio.rasterizer.cuda import camera_tensors
from studio.rasterizer.types import Pinhole
from tests.support.rigs import camera_at

CPU = torch.device("cpu")


def test_they_project_as_the_camera_does() -> None:
    camera = camera_at("cam0", (2.0, 1.0, -0.5)).cropped(5, 3, 30, 20)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 3))
    view = camera_tensors(Pinhole.of(camera), CPU)
    local = torch.from_numpy(points).float() @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
    projected = local @ view.intrinsics.T
    found = projected[:, :2] / projected[:, 2:] + view.shift
    expected = (points @ camera.rotation.T + camera.translation) @ camera.K.T
    np.testing.assert_allclose(found, expected[:, :2] / expected[:, 2:], atol=1e-3)
    assert view.size.tolist() == [30, 20]
    np.testing.assert_allclose(view.center, camera.center, atol=1e-6)


def test_a_camera_that_a_viewer_uploaded_can_be_trained_with() -> None:
    with torch.inference_mode():
        view = camera_tensors(Pinhole.of(camera_at("cam0", (1.5, 1.0, -0.5))), CPU)
    means = torch.zeros(3, 3, requires_grad=True)
    (means @ view.world_to_camera[:3, :3] - view.center).square().sum().backward()
    assert means.grad is not None
