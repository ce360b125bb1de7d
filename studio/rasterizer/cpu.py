"""The CPU backend: the C++ kernels as a differentiable torch function, in float32 and float64.

The kernels in `csrc/` take raw arrays and do not link to torch, so one build works with any version of torch. They have
their own thread pool (`csrc/threads.h`), which is less affected by other load on the machine than torch's.
"""

import importlib
from typing import Any

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.types import ALPHA_MAX, NEAR, Render, field_limits

KERNEL_INTERFACE = 4
"""Number of the functions and arguments of the kernels that this code calls; as `interface` in `csrc/module.cpp`."""


def load_kernels() -> Any:
    """The compiled module `studio.rasterizer._kernels`."""
    try:
        kernels = importlib.import_module("v3studio.studio.rasterizer._kernels")
        if getattr(kernels, "interface", 1) != KERNEL_INTERFACE:
            raise ImportError(f"{kernels.__file__} was built from other sources")
        return kernels
    except ImportError as error:
        problem = f"the CPU kernels cannot be loaded ({error})"
        fix = "Reinstall the package: `pip install --no-deps -e .`"
        raise StudioError("rasterizer.kernels_missing", problem, fix=fix) from None


_threads: int | None = None


def set_kernel_threads(count: int | None) -> None:
    """Set the number of threads of the CPU rasterizer and photometric loss; None means `torch.get_num_threads()`.
    StudioError (`rasterizer.invalid_argument`) if it is below 1."""
    global _threads
    if count is not None and count < 1:
        problem = f"the number of kernel threads is {count}; it must be at least 1"
        raise StudioError("rasterizer.invalid_argument", problem, value=count, argument="count")
    _threads = count


def kernel_threads() -> int:
    """Number of threads that the kernels use. The results do not depend on it, bit for bit."""
    return _threads if _threads is not None else torch.get_num_threads()


def camera_numbers(camera: Camera) -> np.ndarray:
    """(23,) float64 in the order expected by the kernels: rotation, translation, center, fx, fy, cx, cy, limits."""
    intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy, *field_limits(camera)]
    return np.concatenate([camera.rotation.reshape(-1), camera.translation, camera.center, intrinsics])


class _Rasterize(torch.autograd.Function):
    """forward(attributes..., offsets, background, camera, dilation) -> image, alpha, depth, radii."""

    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quats: Tensor,
        log_scales: Tensor,
        logits: Tensor,
        sh: Tensor,
        offsets: Tensor | None,
        background: Tensor | None,
        camera: Camera,
        dilation: float,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        kernels = load_kernels()
        splats = [tensor.detach().contiguous() for tensor in (means, quats, log_scales, logits, sh)]
        height, width = camera.height, camera.width
        # Recycled memory: the pages of a new large tensor cost more than drawing it.
        empty = kernels.empty_float if means.dtype == torch.float32 else kernels.empty_double
        image = empty([height, width, 3])
        alpha, depth = empty([height, width]), empty([height, width])
        radii = means.new_empty(means.shape[0])
        shift = None if offsets is None else offsets.detach().contiguous()
        behind = means.new_zeros(3) if background is None else background.detach().contiguous()
        frame = kernels.forward(
            *splats, shift, camera_numbers(camera), width, height, NEAR, ALPHA_MAX, dilation, behind,
            image, alpha, depth, radii, kernel_threads(),
        )  # fmt: skip
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(radii)
        ctx.frame = frame
        ctx.has_offsets = offsets is not None
        ctx.one_background = background is not None and background.dim() == 1
        ctx.save_for_backward(*splats, image, alpha, depth)
        return image, alpha, depth, radii

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor | None) -> tuple[Tensor | None, ...]:
        *splats, image, alpha, depth = ctx.saved_tensors
        d_image, d_alpha, d_depth = (None if g is None else g.detach().contiguous() for g in outputs[:3])
        # motion trains the means only, which takes fewer sums over the pixels of each splat
        gradients = [
            torch.empty_like(tensor) if needed else None
            for tensor, needed in zip(splats, ctx.needs_input_grad[:5], strict=True)
        ]
        d_offsets = image.new_empty((len(splats[0]), 2)) if ctx.has_offsets and ctx.needs_input_grad[5] else None
        load_kernels().backward(
            ctx.frame, *splats, image, alpha, depth, d_image, d_alpha, d_depth, *gradients, d_offsets, kernel_threads()
        )
        d_background = None
        if ctx.needs_input_grad[6] and d_image is not None:
            d_background = (1 - alpha)[..., None] * d_image
            if ctx.one_background:
                d_background = d_background.sum((0, 1))
        return (*gradients, d_offsets, d_background, None, None)


def rasterize_cpu(
    gaussians: Gaussians,
    camera: Camera,
    background: Tensor | None,
    screen_offsets: Tensor | None,
) -> Render:
    """Render with the C++ kernels. Arguments as in `studio.rasterizer.rasterize`, already validated."""
    if max(camera.width, camera.height) > 32000:
        problem = f"the image is {camera.width}x{camera.height} pixels; the cpu rasterizer supports up to 32000x32000"
        raise StudioError("rasterizer.image_too_large", problem, value=(camera.width, camera.height))
    splats = (tensor for _, tensor in gaussians.items())
    image, alpha, depth, radii = _Rasterize.apply(*splats, screen_offsets, background, camera, gaussians.dilation)
    return Render(image=image, alpha=alpha, depth=depth, radii=radii)
