"""Blending weights per splat, against the image's alpha and against leaving splats out."""

import pytest
import torch

from tests.studio.rasterizer.conftest import make_camera, make_splats
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.rasterizer.contribution import contribution


def test_weights_sum_to_alpha() -> None:
    splats, camera = make_splats(40).to(torch.float32), make_camera()
    contributions = contribution(splats, [camera])
    assert contributions.shape == (40,)
    assert float(contributions.sum()) == pytest.approx(float(rasterize(splats, camera).alpha.sum()), rel=1e-4)


def test_hidden_and_unseen_splats_add_nothing() -> None:
    splats = make_splats(3).to(torch.float32)
    splats.means[:] = torch.tensor([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, -6.0]])
    splats.log_scales[:] = torch.tensor([[-1.0], [-4.0], [-1.0]])
    splats.logit_opacities[:] = 8.0
    front, hidden, behind = contribution(splats, [make_camera(turn=0.0)])
    assert behind == 0
    assert hidden < 0.01 * front
