"""Blending weights per splat, against the picture's alpha and against leaving splats out."""

import numpy as np
import pytest
import torch

from studio.cameras import Camera
from studio.gaussians import Gaussians
from studio.rasterizer import rasterize
from studio.rasterizer.contribution import contribution


@pytest.fixture
def camera():
    K = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    return Camera("c", 64, 48, K, np.eye(4))


def splats(count, seed=0):
    generator = torch.Generator().manual_seed(seed)
    means = torch.rand(count, 3, generator=generator) - 0.5
    means[:, 2] += 3
    return Gaussians(
        means,
        torch.randn(count, 4, generator=generator),
        torch.full((count, 3), -2.5),
        torch.randn(count, generator=generator),
        torch.randn(count, 4, 3, generator=generator),
    )


def test_weights_sum_to_alpha(camera):
    gaussians = splats(40)
    found = contribution(gaussians, [camera])
    assert found.shape == (40,)
    assert float(found.sum()) == pytest.approx(float(rasterize(gaussians, camera).alpha.sum()), rel=1e-4)


def test_hidden_and_unseen_splats_add_nothing(camera):
    gaussians = splats(3)
    gaussians.means[:] = torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [0.0, 0.0, -3.0]])
    gaussians.log_scales[:] = torch.tensor([[-1.0], [-4.0], [-1.0]])
    gaussians.logit_opacities[:] = 8.0
    front, hidden, behind = contribution(gaussians, [camera])
    assert behind == 0
    assert hidden < 0.01 * front
