"""`rasterize`: one way to draw splats, whatever draws them."""

from __future__ import annotations

import functools
import importlib.util

import torch
from torch import Tensor

from studio.cameras import Camera
from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.rasterizer.reference import rasterize_reference
from studio.rasterizer.types import ALPHA_MAX, Pinhole, Render

BACKENDS = ("reference", "cpu", "cuda")


@functools.cache
def _why_not(backend: str) -> str | None:
    """None where the backend can be used, else a sentence that says why it cannot."""
    if backend == "cpu":
        if importlib.util.find_spec("studio.rasterizer._kernels") is None:
            return "The CPU kernel is not built; install the package (`pip install -e .`) or use backend='reference'."
    elif backend == "cuda":
        if not torch.cuda.is_available():
            return "The cuda backend needs an NVIDIA GPU that torch can see; use backend='cpu'."
        if importlib.util.find_spec("gsplat") is None:
            return "The cuda backend needs gsplat; install it with `pip install 'v3studio[cuda]'`."
    return None


def available_backends() -> tuple[str, ...]:
    """The backends that can be used here and now, of "reference", "cpu" and "cuda"."""
    return tuple(backend for backend in BACKENDS if _why_not(backend) is None)


def preferred_device() -> torch.device:
    """Where to keep splats for speed: the GPU where torch sees one and gsplat is installed, else the CPU."""
    return torch.device("cuda" if "cuda" in available_backends() else "cpu")


def check_finite(gaussians: Gaussians) -> None:
    """What `checked=True` checks.

    Raises:
        StudioError: an attribute has a value that is not finite, or a quaternion has length 0; names the first.
    """
    for name, tensor in gaussians.items():
        bad = ~torch.isfinite(tensor.detach()).reshape(len(gaussians), -1).all(-1)
        if bad.any():
            splat = int(bad.nonzero()[0, 0])
            raise StudioError(
                f"Gaussians: {name} of splat {splat} is not finite ({tensor[splat].detach().flatten()[:4].tolist()}; "
                f"{int(bad.sum())} of {len(gaussians)} splats); lower the learning rate or remove these splats."
            )
    flat = gaussians.quats.detach().norm(dim=-1) == 0
    if flat.any():
        raise StudioError(f"Gaussians: the quaternion of splat {int(flat.nonzero()[0, 0])} has length 0.")


def _choose(backend: str, device: torch.device) -> str:
    if backend == "auto":
        backend = "cuda" if device.type == "cuda" else "cpu"
    elif backend not in BACKENDS:
        raise StudioError(f"There is no rasterizer '{backend}'; use auto, {', '.join(BACKENDS)}.")
    reason = _why_not(backend)
    if reason is not None:
        raise StudioError(reason)
    if backend in ("cpu", "cuda") and device.type != backend:
        raise StudioError(f"The {backend} rasterizer cannot draw splats that live on '{device}'; move them first.")
    return backend


def rasterize(
    gaussians: Gaussians,
    camera: Camera,
    background: Tensor | None = None,
    *,
    backend: str = "auto",
    screen_offsets: Tensor | None = None,
    near: float = 0.01,
    alpha_max: float | None = None,
    checked: bool = False,
) -> Render:
    """Draw splats from a camera; differentiable in all attributes of the splats (3DGS, sections 4 and 6).

    Args:
        gaussians: N splats, N may be 0.
        camera: a pinhole. Its principal point may lie anywhere, so `camera.cropped(...)` draws a part of the image
            at the cost of that part.
        background: (3,) RGB, or None for black.
        backend: "reference", "cpu", "cuda", or "auto": cuda for splats on a GPU, else cpu.
        screen_offsets: (N, 2) pixels, added to the projected means. Zeros that require a gradient receive the
            screen-space gradient (loss per pixel of shift), which densification needs.
        near: splats whose center is nearer than this along the viewing axis are not drawn; world units, above 0.
        alpha_max: upper clamp of a splat's alpha at a pixel. None: what the backend draws with by itself, 0.99 as in
            3DGS (reference, cpu) or 0.999 as in gsplat 1.5.3 (cuda).
        checked: look for values that are not finite first and name them; without it such splats are left out.

    Returns:
        Render, all of it on the device and in the dtype of the splats.

    Raises:
        StudioError: the camera is no pinhole, a shape, device or dtype does not fit, the backend cannot be used here,
            or (checked) a value is not finite.
    """
    pinhole = Pinhole.of(camera)
    means = gaussians.means
    for name, tensor in gaussians.items():
        if tensor.device != means.device or tensor.dtype != means.dtype:
            raise StudioError(
                f"Gaussians: {name} is {tensor.dtype} on '{tensor.device}' but means are {means.dtype} on "
                f"'{means.device}'; all attributes must share a dtype and a device."
            )
    if not means.dtype.is_floating_point:
        raise StudioError(f"Gaussians must have a floating dtype to be drawn, found {means.dtype}.")
    if background is not None:
        background = torch.as_tensor(background, dtype=means.dtype, device=means.device)
        if background.shape != (3,):
            raise StudioError(f"The background must be one RGB color of shape (3,), found {tuple(background.shape)}.")
    if screen_offsets is not None and screen_offsets.shape != (len(gaussians), 2):
        raise StudioError(f"screen_offsets must be ({len(gaussians)}, 2), found {tuple(screen_offsets.shape)}.")
    if not near > 0:
        raise StudioError(f"The near plane must be above 0, found {near}.")
    if alpha_max is not None and not 0.5 <= alpha_max <= 1.0:
        raise StudioError(f"alpha_max must be from 0.5 to 1, found {alpha_max}.")
    if checked:
        check_finite(gaussians)
    backend = _choose(backend, means.device)
    if backend == "cpu":
        from studio.rasterizer.cpu import rasterize_cpu

        return rasterize_cpu(gaussians, pinhole, background, screen_offsets, near, alpha_max or ALPHA_MAX)
    if backend == "cuda":
        from studio.rasterizer.cuda import rasterize_cuda

        return rasterize_cuda(gaussians, pinhole, background, screen_offsets, near, alpha_max)
    return rasterize_reference(gaussians, pinhole, background, screen_offsets, near, alpha_max or ALPHA_MAX)
