"""Splats at the initial points: color, size and place, from their definitions."""

import math

import numpy as np
import torch

from studio.training.keyframe import initial_gaussians


def test_color_place_and_size() -> None:
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(40, 3, generator=generator)
    colors = torch.rand(40, 3, generator=generator)
    found = initial_gaussians(points, colors, 2)
    assert torch.equal(found.means, points)
    assert found.sh.shape == (40, 9, 3)
    # the constant spherical harmonic is 1 / (2 sqrt(pi)); colors are relative to gray
    np.testing.assert_allclose(0.5 + found.sh[:, 0] / (2 * math.sqrt(math.pi)), colors, atol=1e-6)
    assert not found.sh[:, 1:].any()
    distances = np.linalg.norm(points[:, None].double() - points[None].double(), axis=2)
    nearest = np.sort(distances, axis=1)[:, 1:4].mean(axis=1)
    np.testing.assert_allclose(found.scales.numpy(), np.repeat(nearest[:, None], 3, axis=1), rtol=1e-5)
    assert len(set(found.opacities.tolist())) == 1
    assert 0 < float(found.opacities[0]) < 1
