"""The CUDA backend: gsplat's kernels (Ye et al. 2024, "gsplat") behind `rasterize`.

gsplat compiles its kernels on first use, which takes minutes; the build is cached. It needs nvcc, even to use a cached
build. It is imported only here, and only if torch finds a GPU. Its alpha clamp is a compile-time constant, 0.999 up to
release 1.5.3; any other `alpha_max` raises an error.
"""

from __future__ import annotations

import functools
import importlib
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.rasterizer.types import ALPHA_MIN, Pinhole, Render, mean_depth

TILE = 16
"""Tile size of gsplat, pixels."""


@functools.cache
def load_gsplat() -> Any:
    """The gsplat module.

    Raises:
        StudioError: `rasterizer.gsplat_missing`: it is not installed or fails to import.
    """
    try:
        return importlib.import_module("gsplat")
    except Exception as error:  # the import can raise any error of gsplat's build
        raise StudioError(
            "rasterizer.gsplat_missing",
            f"gsplat cannot be imported ({error})",
            fix="Install it with `pip install gsplat==1.5.3 packaging`, or use backend='cpu'",
        ) from error


@functools.cache
def compiled_alpha_max() -> float:
    """The alpha clamp of the installed gsplat.

    Raises:
        StudioError: `rasterizer.gsplat_version`: the clamp of this release is unknown; also as `load_gsplat`.
    """
    gsplat = load_gsplat()
    try:  # releases after 1.5.3 define it
        return float(importlib.import_module("gsplat.cuda._constants").MAX_ALPHA)
    except (ImportError, AttributeError):
        pass
    release = tuple(int(part) for part in gsplat.__version__.split(".")[:3] if part.isdigit())
    if release <= (1, 5, 3):
        return 0.999
    raise StudioError(
        "rasterizer.gsplat_version",
        f"the alpha clamp of gsplat {gsplat.__version__} is unknown",
        value=gsplat.__version__,
        fix="Install gsplat 1.5.3, or use backend='cpu'",
    )


@dataclass(frozen=True)
class CameraTensors:
    """A pinhole camera on a device, as gsplat expects it.

    gsplat clamps the linearization of the projection to the image plus 15% of its size on each side. Projecting to an
    image of another size and principal point moves that bound to `Pinhole.limits`; the 2D means are shifted back.

    Attributes:
        world_to_camera: (4, 4).
        intrinsics: (3, 3), with the principal point for that other image.
        projected_size: width and height of that other image, pixels.
        shift: (2,) from that other image to the real one, pixels.
        size: (2,) width and height of the real image, pixels.
        center: (3,) camera center, world units.
    """

    world_to_camera: Tensor
    intrinsics: Tensor
    projected_size: tuple[int, int]
    shift: Tensor
    size: Tensor
    center: Tensor


def camera_tensors(pinhole: Pinhole, device: torch.device) -> CameraTensors:
    """The float32 tensors of a camera, uploaded when it is first used; all steps of a frame share them."""
    arrays = (pinhole.rotation, pinhole.translation, pinhole.center)
    numbers = (pinhole.width, pinhole.height, pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)
    return _uploaded(numbers, pinhole.limits, tuple(np.float64(array).tobytes() for array in arrays), device)


@functools.lru_cache(maxsize=1024)
def _uploaded(
    numbers: tuple[float, ...], limits: tuple[float, ...], arrays: tuple[bytes, ...], device: torch.device
) -> CameraTensors:
    width, height, fx, fy, cx, cy = numbers
    left, right, top, bottom = limits
    rotation, translation, center = (np.frombuffer(array) for array in arrays)
    size = (round((right - left) * fx / 1.3), round((bottom - top) * fy / 1.3))
    moved_cx, moved_cy = -left * fx - 0.15 * size[0], -top * fy - 0.15 * size[1]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), translation
    intrinsics = (fx, 0.0, moved_cx, 0.0, fy, moved_cy, 0.0, 0.0, 1.0)
    values = (*pose.ravel(), *intrinsics, cx - moved_cx, cy - moved_cy, width, height, *center)
    with torch.inference_mode(False):  # or training could not use what a viewer has uploaded
        # One upload, which does not wait for the kernels that are queued: the values are copied before it returns.
        flat = torch.tensor(values, dtype=torch.float32).to(device, non_blocking=True)
        parts = flat.split([16, 9, 2, 2, 3])
        return CameraTensors(parts[0].view(4, 4), parts[1].view(3, 3), size, *parts[2:])


def rasterize_cuda(
    gaussians: Gaussians,
    pinhole: Pinhole,
    background: Tensor | None,
    screen_offsets: Tensor | None,
    near: float,
    alpha_max: float | None,
) -> Render:
    """Render with gsplat. Arguments as in `studio.rasterizer.rasterize`, already validated.

    The `radii` are those of gsplat, which are rounded up to whole pixels.

    Raises:
        StudioError: `rasterizer.alpha_max`: gsplat was compiled with another clamp; also as `load_gsplat` and
            `compiled_alpha_max`.
    """
    means = gaussians.means
    gsplat = load_gsplat()
    if alpha_max is not None and not math.isclose(alpha_max, compiled_alpha_max()):
        raise StudioError(
            "rasterizer.alpha_max",
            f"gsplat {gsplat.__version__} clamps alpha at {compiled_alpha_max()}, not at {alpha_max}",
            value=alpha_max,
            fix="Omit alpha_max, or use backend='cpu'",
            expected=compiled_alpha_max(),
        )
    count, height, width = len(gaussians), pinhole.height, pinhole.width
    if count == 0:
        image = means.new_zeros((height, width, 3))
        image = image if background is None else image + background
        empty = means.new_zeros((height, width))
        return Render(image=image, alpha=empty, depth=empty.clone(), radii=means.new_zeros(0))

    # Splats with non-finite values are replaced by finite ones with opacity 0, so that they get no gradient.
    with torch.no_grad():
        parts = [tensor.reshape(count, -1).isfinite().all(-1) for _, tensor in gaussians.items()]
        finite = torch.stack(parts).all(0) & (gaussians.quats.norm(dim=-1) > 0)
    quats = torch.where(finite[:, None], gaussians.quats, torch.ones_like(gaussians.quats))
    means = torch.where(finite[:, None], means, torch.zeros_like(means))
    log_scales = torch.where(finite[:, None], gaussians.log_scales, torch.zeros_like(gaussians.log_scales))
    sh = torch.where(finite[:, None, None], gaussians.sh, torch.zeros_like(gaussians.sh))
    logits = torch.where(finite, gaussians.logit_opacities, torch.zeros_like(gaussians.logit_opacities))
    opacities = torch.where(finite, logits.sigmoid(), torch.zeros_like(logits))

    view = camera_tensors(pinhole, means.device)
    # One camera: C = 1. radii (1, N, 2) int, means2d (1, N, 2), depths (1, N), conics (1, N, 3).
    radii, means2d, depths, conics, _ = gsplat.fully_fused_projection(
        means,
        None,
        quats,
        log_scales.exp(),
        view.world_to_camera[None],
        view.intrinsics[None],
        *view.projected_size,
        eps2d=gaussians.dilation,
        near_plane=near,
        opacities=opacities.detach(),  # only used to bound the footprint
    )
    means2d = means2d + view.shift
    if screen_offsets is not None:
        means2d = means2d + screen_offsets
    with torch.no_grad():
        inside = ((means2d + radii > 0) & (means2d - radii < view.size)).all(-1)
        shown = (radii > 0).all(-1) & (opacities >= ALPHA_MIN) & inside
        radii = torch.where(shown[..., None], radii, torch.zeros_like(radii))
    directions = (means - view.center)[None]
    colors = gsplat.spherical_harmonics(gaussians.sh_degree, directions, sh[None], masks=shown)
    features = torch.cat([(colors + 0.5).clamp_min(0.0), depths[..., None]], -1)
    # gsplat does not initialize the values of culled splats. No tile uses them, but NaN times 0 would reach gradients.
    features = torch.where(shown[..., None], features, torch.zeros_like(features))

    tiles_x, tiles_y = math.ceil(width / TILE), math.ceil(height / TILE)
    _, intersections, flatten_ids = gsplat.isect_tiles(means2d, radii, depths, TILE, tiles_x, tiles_y)
    offsets = gsplat.isect_offset_encode(intersections, 1, tiles_x, tiles_y).reshape(1, tiles_y, tiles_x)
    drawn, alphas = gsplat.rasterize_to_pixels(
        means2d, conics, features, opacities[None], width, height, TILE, offsets, flatten_ids
    )
    alpha = alphas[0, ..., 0]
    image = drawn[0, ..., :3]
    if background is not None:
        image = image + (1 - alpha)[..., None] * background
    depth = mean_depth(drawn[0, ..., 3], alpha)
    visible_radii = torch.where(shown[0], radii[0].amax(-1), 0).to(means.dtype)
    return Render(image=image, alpha=alpha, depth=depth, radii=visible_radii.detach())
