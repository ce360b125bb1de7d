"""gsplat against the reference; needs a GPU."""

from __future__ import annotations

import pytest
import torch

from studio.rasterizer import available_backends, preferred_device, rasterize
from tests.support.errors import refuses

pytestmark = pytest.mark.gpu


@pytest.fixture(autouse=True)
def _gsplat() -> None:
    if "cuda" not in available_backends():
        pytest.skip("gsplat cannot be used")


@pytest.fixture
def alpha_max() -> float:
    from studio.rasterizer.cuda import compiled_alpha_max

    return compiled_alpha_max()


@pytest.mark.parametrize(
    ("count", "degree", "log_scale", "dilation"),
    [(1, 0, -3, 0.3), (300, 1, -3, 0.3), (300, 3, -1, 0.3), (1500, 3, -3.5, 0.3), (300, 1, -4, 0.05)],
)
def test_parity(helpers, alpha_max, count, degree, log_scale, dilation) -> None:  # type: ignore[no-untyped-def]
    camera = helpers.camera()
    splats = helpers.splats(count, degree=degree, log_scale=log_scale, dilation=dilation)
    sturdy = helpers.sturdy(splats, camera, alpha_max)
    options = {"weight": sturdy.double(), "alpha_max": alpha_max}
    truth = helpers.draw(splats, camera, "reference", **options)
    ours = helpers.draw(splats, camera, "cuda", torch.float32, device="cuda", **options)
    helpers.assert_same(ours, truth, where=sturdy)


def test_no_splats(helpers) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(0).to("cuda", torch.float32)
    render = rasterize(splats, helpers.camera(), torch.ones(3))
    assert (render.image == 1).all()
    assert render.image.device.type == "cuda"


def test_values_that_are_not_finite(helpers) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(40).to("cuda", torch.float32)
    for i, (_, tensor) in enumerate(splats.items()):
        tensor.view(40, -1)[i, 0] = float("nan")
    leaves = splats.map(lambda tensor: tensor.clone().requires_grad_())
    render = rasterize(leaves, helpers.camera())
    assert torch.isfinite(render.image).all()
    assert (render.radii[:5] == 0).all()
    render.image.sum().backward()
    for _, tensor in leaves.items():
        assert torch.isfinite(tensor.grad).all()


def test_another_clamp_is_refused(helpers, alpha_max) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(3).to("cuda", torch.float32)
    other = 0.95 if alpha_max != 0.95 else 0.9
    with refuses("rasterizer.alpha_max", value=other, expected=alpha_max):
        rasterize(splats, helpers.camera(), alpha_max=other)


def test_auto_draws_on_the_gpu(helpers) -> None:  # type: ignore[no-untyped-def]
    assert preferred_device().type == "cuda"
    assert rasterize(helpers.splats(3).to("cuda", torch.float32), helpers.camera()).image.device.type == "cuda"
