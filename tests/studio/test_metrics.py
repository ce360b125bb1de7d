"""PSNR and SSIM against closed forms and OpenCV's Gaussian filter."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from v3studio.studio.metrics import psnr, ssim, ssim_map


def pair(height: int = 31, width: int = 43) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    a = torch.rand(height, width, 3, generator=generator, dtype=torch.float64)
    return a, (a + 0.2 * torch.randn(a.shape, generator=generator, dtype=torch.float64)).clamp(0, 1)


def test_psnr_within_a_mask() -> None:
    a = torch.zeros(4, 4, 3)
    b = a.clone()
    b[:2] += 0.1
    b[2:] += 0.5
    mask = torch.zeros(4, 4)
    mask[:2] = 1
    assert psnr(a, b, mask).item() == pytest.approx(20.0, abs=1e-4)
    assert psnr(a, b, mask.bool()).item() == pytest.approx(20.0, abs=1e-4)
    with refuses("metrics.mask_empty"):
        psnr(a, b, torch.zeros(4, 4))


def opencv_ssim(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    def blur(x: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(x, (11, 11), 1.5, borderType=cv2.BORDER_CONSTANT)

    ma, mb = blur(a), blur(b)
    va, vb, cov = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    return (2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))


def test_ssim_is_opencvs() -> None:
    a, b = pair()
    expected = opencv_ssim(a.numpy(), b.numpy())
    np.testing.assert_allclose(ssim_map(a, b).permute(1, 2, 0), expected, atol=1e-9)
    assert ssim(a, b).item() == pytest.approx(expected.mean())


def test_ssim_gradient() -> None:
    a, b = pair(6, 5)
    assert torch.autograd.gradcheck(lambda x: ssim(x, b), (a.requires_grad_(),))


@pytest.mark.parametrize("function", [psnr, ssim])
def test_wrong_shapes(function: Callable[..., torch.Tensor]) -> None:
    a, b = pair()
    with refuses("metrics.image_shape", value=((31, 43, 3), (30, 43, 3))):
        function(a, b[1:])
    with refuses("metrics.image_shape", value=((31, 43), (31, 43))):
        function(a[..., 0], b[..., 0])
    with refuses("metrics.mask_shape", value=(3, 3), expected=(31, 43)):
        psnr(a, b, torch.ones(3, 3))
