"""Selection of the backend, and invalid arguments."""

from typing import Any

import numpy as np
import pytest
import torch

from tests.studio.rasterizer.conftest import make_camera, make_splats
from tests.support.errors import refuses
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize, set_kernel_threads
from v3studio.studio.rasterizer.cpu import kernel_threads


@pytest.mark.parametrize(
    ("options", "code", "fields"),
    [
        ({"backend": "metal"}, "unknown_backend", {"value": "metal"}),
        ({"background": torch.zeros(4)}, "wrong_shape", {"argument": "background", "value": (4,)}),
        ({"screen_offsets": torch.zeros(4, 2)}, "wrong_shape", {"value": (4, 2), "expected": (5, 2)}),
        ({"screen_offsets": torch.zeros(5, 2).half()}, "mixed_tensors", {"argument": "screen_offsets"}),
    ],
)
def test_invalid_arguments(options: dict[str, Any], code: str, fields: dict[str, Any]) -> None:
    with refuses(f"rasterizer.{code}", **fields):
        rasterize(make_splats(5), make_camera(), **options)


def test_mixed_and_unusable_dtypes() -> None:
    splats = make_splats(5)
    mixed = Gaussians(splats.means.float(), splats.quats, splats.log_scales, splats.logit_opacities, splats.sh)
    with refuses("rasterizer.mixed_tensors", argument="quats"):
        rasterize(mixed, make_camera())
    with refuses("rasterizer.dtype", value="torch.float16"):
        rasterize(splats.to(torch.float16), make_camera())


def test_plain_tensors_are_rendered_from_several_cameras_as_their_splats() -> None:
    """Arguments are those of gsplat's `rasterization`; colors are RGB, or spherical harmonics of a degree."""
    splats, cameras = make_splats(40, degree=2), [make_camera(turn=turn) for turn in (0.3, -0.4)]
    poses = torch.tensor(np.stack([camera.world_to_camera for camera in cameras]))
    views = (poses, torch.tensor(np.stack([camera.K for camera in cameras])), 75, 49)
    backgrounds = torch.tensor([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], dtype=torch.float64)
    means = splats.means.clone().requires_grad_()
    shapes = (means, splats.quats, splats.scales, splats.opacities)
    for degree in (0, 1):
        cut = splats.with_sh_degree(degree)
        colors = 0.5 + 0.28209479177387814 * splats.sh[:, 0] if degree == 0 else splats.sh
        given = {} if degree == 0 else {"sh_degree": degree}
        found = rasterize(*shapes, colors, *views, backgrounds=backgrounds, **given)
        renders = [rasterize(cut, camera, color) for camera, color in zip(cameras, backgrounds, strict=True)]
        for name in ("image", "alpha", "depth", "radii"):
            wanted = torch.stack([getattr(render, name) for render in renders])
            torch.testing.assert_close(getattr(found, name), wanted, atol=1e-5, rtol=1e-5)
    found.image.sum().backward()
    assert means.grad is not None
    assert means.grad.abs().sum() > 0
    with refuses("gaussians.wrong_shape", attribute="quats"):
        rasterize(means=means, quats=splats.means, scales=splats.scales, opacities=splats.opacities, colors=splats.sh,
                  viewmats=views[0], Ks=views[1], width=75, height=49, sh_degree=2)  # fmt: skip


def test_a_camera_that_is_no_pinhole() -> None:
    K = np.array([[50.0, 0, 20], [0, 50, 20], [0, 0, 1]])
    bent = Camera("bent", 40, 40, K, np.eye(4), np.array([0.1, 0, 0, 0]))
    with refuses("camera.distortion", camera="bent"):
        rasterize(make_splats(1), bent)
    K[0, 1] = 3.0
    with refuses("camera.skew", camera="skewed", value=3.0):
        rasterize(make_splats(1), Camera("skewed", 40, 40, K, np.eye(4)))


def test_the_kernels_own_number_of_threads() -> None:
    assert kernel_threads() == torch.get_num_threads()
    try:
        set_kernel_threads(1)
        assert kernel_threads() == 1
        with refuses("rasterizer.invalid_argument", argument="count", value=0):
            set_kernel_threads(0)
    finally:
        set_kernel_threads(None)
    assert kernel_threads() == torch.get_num_threads()


def test_splats_on_another_device_are_refused() -> None:
    splats = make_splats(3).to(device=torch.device("meta"))
    with refuses("rasterizer.wrong_device", value="meta"):
        rasterize(splats, make_camera(), backend="cpu")
