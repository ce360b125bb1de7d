"""Which backend draws, and what is refused."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch

from studio.cameras import Camera
from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.rasterizer import available_backends, preferred_device, rasterize, set_kernel_threads
from studio.rasterizer.cpu import kernel_threads


def test_cpu_and_reference_are_there() -> None:
    assert {"cpu", "reference"} <= set(available_backends())


def test_auto_draws_cpu_splats_with_the_kernels(helpers) -> None:  # type: ignore[no-untyped-def]
    camera, splats = helpers.camera(), helpers.splats(50).to(torch.float32)
    assert torch.equal(rasterize(splats, camera).image, rasterize(splats, camera, backend="cpu").image)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_cuda_says_why_it_cannot(helpers) -> None:  # type: ignore[no-untyped-def]
    assert "cuda" not in available_backends()
    assert preferred_device() == torch.device("cpu")
    with pytest.raises(StudioError, match="needs an NVIDIA GPU"):
        rasterize(helpers.splats(1), helpers.camera(), backend="cuda")


def test_importing_the_rasterizer_leaves_gsplat_alone() -> None:
    code = "import sys, studio.rasterizer; sys.exit('gsplat' in sys.modules or 'open3d' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"backend": "metal"}, "no rasterizer 'metal'"),
        ({"background": torch.zeros(4)}, r"\(3,\), found \(4,\)"),
        ({"screen_offsets": torch.zeros(4, 2)}, r"must be \(5, 2\), found \(4, 2\)"),
        ({"near": 0.0}, "above 0"),
        ({"near": float("nan")}, "above 0"),
        ({"alpha_max": 1.5}, "0.5 to 1, found 1.5"),
        ({"screen_offsets": torch.zeros(5, 2, dtype=torch.float16)}, "dtype"),
    ],
)
def test_bad_arguments(helpers, options, message) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(StudioError, match=message):
        rasterize(helpers.splats(5), helpers.camera(), **options)


def test_mixed_and_unusable_dtypes(helpers) -> None:  # type: ignore[no-untyped-def]
    splats = helpers.splats(5)
    mixed = Gaussians(splats.means.float(), splats.quats, splats.log_scales, splats.logit_opacities, splats.sh)
    with pytest.raises(StudioError, match="share a dtype"):
        rasterize(mixed, helpers.camera())
    with pytest.raises(StudioError, match=r"float32 and float64, found torch\.float16"):
        rasterize(splats.to(torch.float16), helpers.camera())


def test_a_camera_that_is_no_pinhole(helpers) -> None:  # type: ignore[no-untyped-def]
    K = np.array([[50.0, 0, 20], [0, 50, 20], [0, 0, 1]])
    bent = Camera("bent", 40, 40, K, np.eye(4), np.array([0.1, 0, 0, 0]))
    with pytest.raises(StudioError, match="'bent' has lens distortion"):
        rasterize(helpers.splats(1), bent)
    K[0, 1] = 3.0
    with pytest.raises(StudioError, match="'skewed' has skew"):
        rasterize(helpers.splats(1), Camera("skewed", 40, 40, K, np.eye(4)))


def test_the_background_takes_the_dtype_of_the_splats(helpers) -> None:  # type: ignore[no-untyped-def]
    white = torch.ones(3, dtype=torch.float64)
    image = rasterize(helpers.splats(0).to(torch.float32), helpers.camera(), white).image
    assert image.dtype == torch.float32
    assert (image == 1).all()


def test_the_kernels_own_number_of_threads() -> None:
    assert kernel_threads() == torch.get_num_threads()
    try:
        set_kernel_threads(1)
        assert kernel_threads() == 1
        with pytest.raises(StudioError, match="at least one thread, found 0"):
            set_kernel_threads(0)
    finally:
        set_kernel_threads(None)
    assert kernel_threads() == torch.get_num_threads()
