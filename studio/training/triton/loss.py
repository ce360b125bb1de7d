"""The photometric loss on an NVIDIA GPU: four kernels of Triton for its value and gradient instead of about forty of
PyTorch, and no wait for the GPU.

SSIM blurs five moments of the two images and, for the gradient, three derivatives. The window is separable: a kernel
for the rows is followed by one for the columns. All images and planes are (H, W, 3), so that one element to the right
is three numbers further. Sums have a row for each program and no atomic operations, so that the same input gives the
same bits.
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
import functools
import math

import torch
import triton
import triton.language as tl
from torch import Tensor

from v3studio.studio.metrics import SSIM_C1, SSIM_C2, SSIM_WINDOW, ssim_taps
from v3studio.studio.training.known_gradients import with_gradients

WARPS = 4  # warps of a program
BLOCK = 1024  # elements of a program: pixels times channels
_BLOCK = tl.constexpr(BLOCK)
_WINDOW = tl.constexpr(SSIM_WINDOW)
_HALF = tl.constexpr(SSIM_WINDOW // 2)
_C1 = tl.constexpr(SSIM_C1)
_C2 = tl.constexpr(SSIM_C2)


@triton.jit
def _elements(count):
    """This program's elements, and which of them are inside the image."""
    element = tl.program_id(0) * _BLOCK + tl.arange(0, _BLOCK)
    return element, element < count


@triton.jit
def _blur(plane, taps, element, inside, position, size, step):
    """A plane, blurred in one direction: `position` of `size` in it, `step` elements from one to the next."""
    blurred = tl.zeros([_BLOCK], tl.float32)
    for tap in tl.static_range(_WINDOW):
        there = position + (tap - _HALF)
        seen = inside & (there >= 0) & (there < size)
        blurred += tl.load(taps + tap) * tl.load(plane + element + (tap - _HALF) * step, mask=seen, other=0.0)
    return blurred


@triton.jit
def blur_rows_of_moments(image, target, taps, planes, width, count):
    """Blur x, y, x * x, y * y and x * y of the images x and y along the rows.

    Args:
        image, target: (H, W, 3) float32.
        taps: (11,) float32, the window.
        planes: (5, H, W, 3) float32, output.
        width, count: columns, and elements of an image (3 H W).
    """
    element, inside = _elements(count)
    column = (element // 3) % width
    x = tl.zeros([_BLOCK], tl.float32)
    y = tl.zeros([_BLOCK], tl.float32)
    xx = tl.zeros([_BLOCK], tl.float32)
    yy = tl.zeros([_BLOCK], tl.float32)
    xy = tl.zeros([_BLOCK], tl.float32)
    for tap in tl.static_range(_WINDOW):
        there = column + (tap - _HALF)
        seen = inside & (there >= 0) & (there < width)
        weight = tl.load(taps + tap)
        a = tl.load(image + element + (tap - _HALF) * 3, mask=seen, other=0.0)
        b = tl.load(target + element + (tap - _HALF) * 3, mask=seen, other=0.0)
        x += weight * a
        y += weight * b
        xx += weight * a * a
        yy += weight * b * b
        xy += weight * a * b
    tl.store(planes + element, x, mask=inside)
    tl.store(planes + count + element, y, mask=inside)
    tl.store(planes + 2 * count + element, xx, mask=inside)
    tl.store(planes + 3 * count + element, yy, mask=inside)
    tl.store(planes + 4 * count + element, xy, mask=inside)


@triton.jit
def compare(image, target, taps, planes, derivatives, sums, width, height, count):
    """Blur the moments along the columns; absolute differences, SSIM, and SSIM's derivatives.

    Args:
        image, target, taps, width, count: as above; height: rows.
        planes: (5, H, W, 3) float32, from `blur_rows_of_moments`.
        derivatives: (3, H, W, 3) float32, output: derivatives of SSIM with respect to the blurred x, x * x and x * y.
        sums: (programs, 2) float32, output: sums of |x - y| and of SSIM.
    """
    element, inside = _elements(count)
    row = element // 3 // width
    x = _blur(planes, taps, element, inside, row, height, 3 * width)
    y = _blur(planes + count, taps, element, inside, row, height, 3 * width)
    xx = _blur(planes + 2 * count, taps, element, inside, row, height, 3 * width)
    yy = _blur(planes + 3 * count, taps, element, inside, row, height, 3 * width)
    xy = _blur(planes + 4 * count, taps, element, inside, row, height, 3 * width)
    # SSIM = a1 a2 / (b1 b2), Wang et al. 2004, equation 13
    a1 = 2.0 * x * y + _C1
    a2 = 2.0 * (xy - x * y) + _C2
    b1 = x * x + y * y + _C1
    b2 = (xx - x * x) + (yy - y * y) + _C2
    similarity = a1 * a2 / (b1 * b2)
    difference = tl.load(image + element, mask=inside, other=0.0) - tl.load(target + element, mask=inside, other=0.0)
    tl.store(sums + tl.program_id(0) * 2, tl.sum(tl.abs(difference), axis=0))
    tl.store(sums + tl.program_id(0) * 2 + 1, tl.sum(tl.where(inside, similarity, 0.0), axis=0))
    by_x = 2.0 * y * (a2 - a1) / (b1 * b2) - 2.0 * x * similarity * (1.0 / b1 - 1.0 / b2)
    tl.store(derivatives + element, by_x, mask=inside)
    tl.store(derivatives + count + element, -similarity / b2, mask=inside)
    tl.store(derivatives + 2 * count + element, 2.0 * a1 / (b1 * b2), mask=inside)


@triton.jit
def blur_rows(planes, taps, blurred, width, count):
    """Blur three planes along the rows.

    Args:
        planes: (3, H, W, 3) float32; blurred: the same, output.
        taps, width, count: as above.
    """
    element, inside = _elements(count)
    column = (element // 3) % width
    for plane in tl.static_range(3):
        value = _blur(planes + plane * count, taps, element, inside, column, width, 3)
        tl.store(blurred + plane * count + element, value, mask=inside)


@triton.jit
def combine(image, target, taps, planes, gradient, width, height, count, of_l1, of_ssim):
    """Blur the derivatives along the columns and add them to the gradient of the absolute differences.

    Args:
        image, target, taps, width, height, count: as above.
        planes: (3, H, W, 3) float32, the derivatives, blurred along the rows.
        gradient: (H, W, 3) float32, output.
        of_l1, of_ssim: derivatives of the loss with respect to the sum of |x - y| and to the sum of SSIM.
    """
    element, inside = _elements(count)
    row = element // 3 // width
    by_x = _blur(planes, taps, element, inside, row, height, 3 * width)
    by_xx = _blur(planes + count, taps, element, inside, row, height, 3 * width)
    by_xy = _blur(planes + 2 * count, taps, element, inside, row, height, 3 * width)
    x = tl.load(image + element, mask=inside, other=0.0)
    y = tl.load(target + element, mask=inside, other=0.0)
    sign = tl.where(x > y, 1.0, tl.where(x < y, -1.0, 0.0))
    value = of_l1 * sign + of_ssim * (by_x + 2.0 * x * by_xx + y * by_xy)
    tl.store(gradient + element, value, mask=inside)


@functools.cache
def _taps(device: torch.device) -> Tensor:
    return torch.tensor(ssim_taps(), dtype=torch.float32, device=device)


def photometric_loss_triton(image: Tensor, target: Tensor, weight: float) -> Tensor:
    """`studio.training.photometric.photometric_loss` for float32 on an NVIDIA GPU, or with Triton's interpreter."""
    data, target = image.detach().contiguous(), target.detach().contiguous()
    height, width, _ = data.shape
    count = data.numel()
    taps = _taps(data.device)
    moments, derivatives = data.new_empty((5, *data.shape)), data.new_empty((3, *data.shape))
    programs = (math.ceil(count / BLOCK),)
    sums = data.new_empty((*programs, 2))
    gradient = None
    with torch.cuda.device_of(data):
        blur_rows_of_moments[programs](data, target, taps, moments, width, count, num_warps=WARPS)
        compare[programs](data, target, taps, moments, derivatives, sums, width, height, count, num_warps=WARPS)
        if image.requires_grad:
            blurred, gradient = moments[:3], torch.empty_like(data)  # the moments are no longer needed
            blur_rows[programs](derivatives, taps, blurred, width, count, num_warps=WARPS)
            combine[programs](
                data, target, taps, blurred, gradient, width, height, count, (1 - weight) / count, -weight / count,
                num_warps=WARPS,
            )  # fmt: skip
    l1, similarity = (sums.sum(0, dtype=torch.float64) / count).unbind()
    loss = ((1 - weight) * l1 + weight * (1 - similarity)).to(data.dtype)
    return with_gradients(loss, [image], [gradient])
