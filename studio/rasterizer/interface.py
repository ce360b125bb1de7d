"""`rasterize`: one interface to all backends."""

import functools
import importlib.util
import os
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, overload

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.rasterizer.reference import rasterize_reference
from v3studio.studio.rasterizer.types import Render, check_pinhole

BACKENDS = ("reference", "cpu", "triton")
_DTYPES = {"cpu": (torch.float32, torch.float64), "triton": (torch.float32,)}


@functools.cache
def _unavailable(backend: str) -> tuple[str, str] | None:
    """None if the backend can be used on this machine, else (problem, fix)."""
    if backend == "cpu":
        if importlib.util.find_spec("v3studio.studio.rasterizer._kernels") is None:
            return (
                "the CPU kernels are not built",
                "Install the package (`pip install --no-deps -e .`), or use backend='reference'",
            )
    elif backend == "triton":
        if not torch.cuda.is_available() and not _interpreted():
            return "the triton backend needs an NVIDIA GPU that torch can use", "Use backend='cpu'"
        if importlib.util.find_spec("triton") is None:
            return (
                "the triton backend needs Triton",
                "Install a CUDA build of PyTorch for Linux, which brings it, or use the CPU",
            )
    return None


def _interpreted() -> bool:
    """Return whether Triton runs kernels on the CPU: TRITON_INTERPRET=1, for tests and for debugging."""
    return os.environ.get("TRITON_INTERPRET") == "1"


def available_backends() -> tuple[str, ...]:
    """The backends of `BACKENDS` that can be used on this machine."""
    return tuple(backend for backend in BACKENDS if _unavailable(backend) is None)


def preferred_device() -> torch.device:
    """The fastest device for splats: an NVIDIA GPU if torch and Triton can use one, else the CPU."""
    return torch.device("cuda" if torch.cuda.is_available() and _unavailable("triton") is None else "cpu")


def check_finite(gaussians: Gaussians) -> None:
    """The check of `rasterize(checked=True)`. The StudioError names the first bad splat: `gaussians.not_finite`: an
    attribute is NaN or infinite; `gaussians.zero_quaternion`: a quaternion has norm 0."""
    for name, tensor in gaussians.items():
        bad = ~torch.isfinite(tensor.detach()).reshape(len(gaussians), -1).all(-1)
        if bad.any():
            splat = int(bad.nonzero()[0, 0])
            problem = (
                f"{name} of splat {splat} is not finite: {tensor[splat].detach().flatten()[:4].tolist()} "
                f"({int(bad.sum())} of {len(gaussians)} splats)"
            )
            fix = "Lower the learning rate, or remove these splats"
            raise StudioError(
                "gaussians.not_finite", problem, fix=fix, attribute=name, splat=splat, count=int(bad.sum())
            )
    flat = gaussians.quats.detach().norm(dim=-1) == 0
    if flat.any():
        splat = int(flat.nonzero()[0, 0])
        raise StudioError("gaussians.zero_quaternion", f"the quaternion of splat {splat} has norm 0", splat=splat)


def _choose(backend: str, device: torch.device) -> str:
    if backend == "auto":
        backend = "triton" if device.type == "cuda" else "cpu"
    elif backend not in BACKENDS:
        fix = f"Use auto, {', '.join(BACKENDS)}"
        raise StudioError("rasterizer.unknown_backend", f"unknown backend '{backend}'", value=backend, fix=fix)
    reason = _unavailable(backend)
    if reason is not None:
        raise StudioError("rasterizer.backend_unavailable", reason[0], value=backend, fix=reason[1])
    types = {"cpu": "cpu", "triton": "cpu" if _interpreted() else "cuda"}
    if backend in types and device.type != types[backend]:
        problem = f"the {backend} rasterizer cannot render splats on '{device}'"
        fix = f"Move the splats to '{types[backend]}'"
        raise StudioError("rasterizer.wrong_device", problem, value=str(device), fix=fix, backend=backend)
    return backend


def _bad_shape(argument: str, expected: tuple[int, ...], tensor: Tensor) -> StudioError:
    own_shape = tuple(tensor.shape)
    problem = f"{argument} has shape {own_shape}; expected {expected}"
    return StudioError("rasterizer.wrong_shape", problem, value=own_shape, argument=argument, expected=expected)


def _check_alike(argument: str, tensor: Tensor, means: Tensor) -> None:
    if tensor.device != means.device or tensor.dtype != means.dtype:
        problem = f"{argument} is {tensor.dtype} on '{tensor.device}', but means is {means.dtype} on '{means.device}'"
        fix = "Use one dtype and one device for all attributes"
        raise StudioError("rasterizer.mixed_tensors", problem, fix=fix, argument=argument)


@overload
def rasterize(
    gaussians: Gaussians,
    camera: Camera,
    background: Tensor | None = None,
    *,
    backend: str = "auto",
    screen_offsets: Tensor | None = None,
    checked: bool = False,
) -> Render: ...


@overload
def rasterize(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    *,
    sh_degree: int | None = None,
    backgrounds: Tensor | None = None,
    backend: str = "auto",
) -> Render: ...


def rasterize(*splats_and_views: Any, **options: Any) -> Render:
    """Render splats from a camera; differentiable with respect to all attributes (3DGS, sections 4 and 6).

    Example:
        >>> splats = v3.trained_video("my-take").read(0)
        >>> camera = v3.orbit(splats.means.mean(dim=0), 3.0, 1, width=64, height=48)["orbit000"]
        >>> render = v3.rasterize(splats, camera)
        >>> render.image.shape, bool(render.alpha.max() > 0.5)
        (torch.Size([48, 64, 3]), True)

    It also takes plain tensors, named and shaped as those of gsplat's `rasterization`, with C cameras. The tensors of
    the `Render` then begin with a dimension for the cameras.

        >>> pose, K = torch.tensor(camera.world_to_camera)[None].float(), torch.tensor(camera.K)[None].float()
        >>> activated = splats.means, splats.quats, splats.scales, splats.opacities, splats.sh
        >>> v3.rasterize(*activated, pose, K, 64, 48, sh_degree=splats.sh_degree).image.shape
        torch.Size([1, 48, 64, 3])

    Args:
        gaussians: N splats, N may be 0, rendered with their own dilation.
        camera: a pinhole camera without distortion. The principal point may be outside the image, so
            `camera.cropped(...)` renders a part of the image at the cost of that part.
        background: (3,) RGB, or an (H, W, 3) image; None: black.
        backend: "reference", "cpu", "triton" (float32 only), or "auto": triton for splats on a GPU, cpu for others.
        screen_offsets: (N, 2) offsets in pixels, added to the 2D means. Pass zeros that require a gradient to get the
            screen-space gradient (loss per pixel), which densification uses.
        checked: raise an error for non-finite values. Otherwise, splats with such values are not drawn.
        means, quats, scales, opacities: (N, 3), (N, 4) wxyz, (N, 3) and (N,); scales and opacities as they are drawn,
            not logarithms and logits.
        colors: (N, 3) RGB of at least 0, or (N, K, 3) spherical harmonics with `sh_degree`, of which higher ones are
            not used.
        viewmats, Ks: (C, 4, 4) world to camera and (C, 3, 3) intrinsics, not differentiable.
        width, height: of the images, pixels.
        backgrounds: (C, 3) RGB; None: black.

    Returns:
        The `Render`, with the device and dtype of the splats.

    Raises:
        StudioError: `camera.distortion`, `camera.skew`: not a pinhole camera; `rasterizer.*`: a shape, device, dtype or
            argument is invalid, or the backend is not available here; with `checked`, as `check_finite`.
    """
    if "means" in options or (splats_and_views and isinstance(splats_and_views[0], Tensor)):
        return _rasterize_tensors(*splats_and_views, **options)
    return _rasterize(*splats_and_views, **options)


def _rasterize(gaussians: Gaussians, camera: Camera, background: Tensor | None = None, **options: Any) -> Render:
    (render,) = rasterize_views(gaussians, [camera], [background], **options)
    return render


def _rasterize_tensors(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    *,
    sh_degree: int | None = None,
    backgrounds: Tensor | None = None,
    backend: str = "auto",
) -> Render:
    sh = (colors[:, None] - 0.5) / SH_C0 if sh_degree is None else colors[:, : (sh_degree + 1) ** 2]
    cameras = [
        Camera(name=f"view {number}", width=width, height=height, K=K, world_to_camera=pose)
        for number, (K, pose) in enumerate(zip(_doubles(Ks), _doubles(viewmats), strict=True))
    ]
    behind = [None] * len(cameras) if backgrounds is None else list(backgrounds)
    splats = Gaussians.from_activated(means, quats, scales, opacities, sh)
    renders = rasterize_views(splats, cameras, behind, backend=backend)
    stacked = {field.name: torch.stack([getattr(render, field.name) for render in renders]) for field in fields(Render)}
    return Render(**stacked)


def _doubles(tensor: Tensor) -> np.ndarray:
    return np.asarray(tensor.detach().cpu(), np.float64)


def rasterize_views(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    backgrounds: Sequence[Tensor | None],
    *,
    backend: str = "auto",
    screen_offsets: Tensor | None = None,
    checked: bool = False,
) -> list[Render]:
    """Render the same splats from several cameras, each over its own background, otherwise as `rasterize`; on a GPU,
    the triton backend does so in one call."""
    for camera in cameras:
        check_pinhole(camera)
    means = gaussians.means
    for name, tensor in gaussians.items():
        _check_alike(name, tensor, means)
    if not means.dtype.is_floating_point:
        problem = f"splats must have a floating-point dtype, not {means.dtype}"
        raise StudioError("rasterizer.dtype", problem, value=str(means.dtype))
    behind = [_background(color, camera, means) for color, camera in zip(backgrounds, cameras, strict=True)]
    if screen_offsets is not None:
        if screen_offsets.shape != (len(gaussians), 2):
            raise _bad_shape("screen_offsets", (len(gaussians), 2), screen_offsets)
        _check_alike("screen_offsets", screen_offsets, means)
    if checked:
        check_finite(gaussians)
    backend = _choose(backend, means.device)
    if means.dtype not in _DTYPES.get(backend, (means.dtype,)):
        problem = f"the {backend} rasterizer does not support {means.dtype}"
        fix = "Convert the splats to float32, or use backend='reference'"
        raise StudioError("rasterizer.dtype", problem, value=str(means.dtype), fix=fix)
    if backend == "triton":
        try:
            from v3studio.studio.rasterizer.triton_backend import rasterize_triton
        except ImportError as error:
            fix = "Reinstall a CUDA build of PyTorch for Linux, which installs it, or use backend='cpu'"
            raise StudioError("rasterizer.triton_missing", f"Triton cannot be imported ({error})", fix=fix) from error
        return rasterize_triton(gaussians, cameras, behind, screen_offsets)
    both = zip(cameras, behind, strict=True)
    if backend == "cpu":
        from v3studio.studio.rasterizer.cpu import rasterize_cpu

        return [rasterize_cpu(gaussians, *scene, screen_offsets) for scene in both]
    return [rasterize_reference(gaussians, *scene, screen_offsets) for scene in both]


def _background(background: Tensor | None, camera: Camera, means: Tensor) -> Tensor | None:
    """The background with the splats' device and dtype."""
    if background is None:
        return None
    background = torch.as_tensor(background, dtype=means.dtype, device=means.device)
    if background.shape not in ((3,), (camera.height, camera.width, 3)):
        raise _bad_shape("background", (3,), background)
    return background
