"""The Triton backend: tile-wise blending on an NVIDIA GPU, in float32.

Triton compiles the kernels of `triton_kernels.py` when they are first used, with the assembler in its own package, in
seconds. PyTorch's CUDA builds for Linux install it. It is imported only with this module.

One call draws any number of views of the same splats, so that a training step with several views launches no more
kernels than one with a single view. Binning is torch: splats are sorted by view and depth, then their pairs with tiles
stably by tile, so that splats of equal depth keep their order. A call waits for the GPU once, for the numbers of drawn
splats and of pairs: the sizes of what it allocates.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import triton_kernels as kernels
from v3studio.studio.rasterizer.types import ALPHA_MAX, NEAR, Render, field_limits, mean_depth

FORWARD_WARPS, BACKWARD_WARPS, PROJECT_WARPS = 4, 1, 4
"""Warps per program. One for the gradient of a tile: its ten sums per splat then need no synchronization of warps."""
_VIEWS_AT_ONCE = 32  # Most views of a call. Pixels are numbered through all of them, with 32 bits


@dataclass(frozen=True)
class Views:
    """The views of a call, on the splats' device."""

    sizes: tuple[tuple[int, int], ...]  # (width, height) of each, pixels
    tiles: int
    pixels: int
    # cameras, frames: (V, 32) float32 and int32, the same memory. Of each view, as floats: rotation (9 numbers) and
    # translation (3) of world_to_camera, camera center (3), fx, fy, cx, cy, `field_limits` (4), from 23 on nothing;
    # as integers, from 24 on: first tile, width, height, tiles in a row and in a column, first pixel
    cameras: Tensor
    frames: Tensor

    @classmethod
    def of(cls, cameras: Sequence[Camera], device: torch.device) -> Views:
        """The views of cameras."""
        numbers = np.zeros((len(cameras), 32), np.float32)
        integers = numbers.view(np.int32)
        tiles = pixels = 0
        for row, whole, camera in zip(numbers, integers, cameras, strict=True):
            row[:9], row[9:12], row[12:15] = np.ravel(camera.rotation), camera.translation, camera.center
            row[15:23] = camera.fx, camera.fy, camera.cx, camera.cy, *field_limits(camera)
            across, down = math.ceil(camera.width / kernels.TILE), math.ceil(camera.height / kernels.TILE)
            whole[24:30] = tiles, camera.width, camera.height, across, down, pixels
            tiles, pixels = tiles + across * down, pixels + camera.width * camera.height
        frames = _uploaded(integers.tobytes(), device)
        sizes = tuple((camera.width, camera.height) for camera in cameras)
        return cls(sizes, tiles, pixels, frames.view(torch.float32), frames)


@functools.lru_cache(maxsize=1024)
def _uploaded(numbers: bytes, device: torch.device) -> Tensor:
    with torch.inference_mode(False):  # or training could not use what a viewer has uploaded
        # This does not wait for the kernels that are queued: the numbers are copied before it returns.
        rows = torch.from_numpy(np.frombuffer(numbers, np.int32).reshape(-1, 32).copy())
        return rows.to(device, non_blocking=True)


@dataclass(frozen=True)
class Tiles:
    """Pairs (tile, splat) of D drawn splats, sorted by tile and then by depth. A splat counts once for each view."""

    owners: Tensor  # (P,) int32, the drawn splat of each pair
    slots: Tensor  # (P,) int64, number of each pair when sorted by splat
    starts: Tensor  # (tiles + 1,) int64, first pair of each tile
    ends: Tensor  # (D,) int64, one past the last pair of each splat when sorted by splat


@torch.no_grad()
def bin_splats(boxes: Tensor, keys: Tensor, half: Tensor, tiles: int) -> tuple[Tensor, Tiles]:
    """(D,) places of the drawn splats, view by view, nearest first; and the tiles that their boxes overlap. Boxes, keys
    and half sizes are as written by `project_splats`."""
    drawn, total = torch.stack([(half[:, 0] > 0).sum(), boxes[:, 3].sum()]).tolist()  # the one wait
    index = torch.sort(keys, stable=True).indices[:drawn]
    boxes = boxes[index]
    counts = boxes[:, 3].long()
    ends = counts.cumsum(0)
    owners = torch.repeat_interleave(counts, output_size=total)
    within = torch.arange(total, device=half.device) - (ends - counts)[owners]
    first, across, columns, _ = boxes[owners].unbind(-1)
    of_pairs = first + within // columns * across + within % columns
    narrow = torch.int16 if tiles < 2**15 else torch.int32  # fewer digits to sort by
    of_pairs, slots = torch.sort(of_pairs.to(narrow), stable=True)
    edges = torch.arange(tiles + 1, device=half.device, dtype=torch.int32)
    starts = torch.searchsorted(of_pairs.int(), edges)
    return index, Tiles(owners[slots].int(), slots, starts, ends)


def project_all(gaussians: Gaussians, views: Views, offsets: Tensor | None) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The outputs of `project_splats`: `table`, `half`, `boxes` and `keys`. Arguments as in `rasterize_triton`."""
    like, count = gaussians.means, len(gaussians)
    places = len(views.sizes) * count
    table, half = like.new_empty((places, kernels.COLUMNS)), like.new_empty((places, 2))
    boxes = torch.empty((places, 4), dtype=torch.int32, device=like.device)
    keys = torch.empty(places, dtype=torch.int64, device=like.device)
    if count:
        with torch.cuda.device_of(like):
            kernels.project_splats[(math.ceil(count / kernels.BLOCK), len(views.sizes))](
                *(tensor for _, tensor in gaussians.items()),
                table if offsets is None else offsets,  # not read without offsets
                views.cameras, views.frames, table, half, boxes, keys, count, NEAR, gaussians.dilation,
                COEFFICIENTS=gaussians.sh.shape[1], OFFSETS=offsets is not None, num_warps=PROJECT_WARPS,
            )  # fmt: skip
    return table, half, boxes, keys


class _Draw(torch.autograd.Function):
    """Image, sum of weighted depths, and transmittance of all pixels; and the (V, N) radii, which have no gradient."""

    @staticmethod
    def forward(
        ctx: Any, views: Views, dilation: float, offsets: Tensor | None, *splats: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        splats = tuple(tensor.detach().contiguous() for tensor in splats)
        means, quats, log_scales, logits, sh = splats
        gaussians = Gaussians(means, quats, log_scales, logits, sh, dilation)
        shift = None if offsets is None else offsets.detach().contiguous()
        places, half, boxes, keys = project_all(gaussians, views, shift)
        index, tiles = bin_splats(boxes, keys, half, views.tiles)
        table = places.index_select(0, index)
        image = table.new_empty((views.pixels, 3))
        depth, transmittance = image.new_empty(views.pixels), image.new_empty(views.pixels)
        last = torch.empty_like(depth, dtype=torch.int32)
        with torch.cuda.device_of(table):
            kernels.blend_tile[(views.tiles,)](
                table, tiles.owners, tiles.starts, views.frames, image, depth, transmittance, last,
                len(views.sizes), ALPHA_MAX, num_warps=FORWARD_WARPS, enable_fp_fusion=True,
            )  # fmt: skip
        ctx.views, ctx.tiles, ctx.dilation = views, tiles, dilation
        ctx.save_for_backward(*splats, table, index, transmittance, last)
        radii = half.amax(-1).view(len(views.sizes), len(gaussians))
        ctx.mark_non_differentiable(radii)
        return image, depth, transmittance, radii

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        views, tiles, dilation = ctx.views, ctx.tiles, ctx.dilation
        *splats, table, index, transmittance, last = ctx.saved_tensors
        means, quats, log_scales, logits, sh = splats
        count, coefficients, colors = len(means), sh.shape[1], ctx.needs_input_grad[-1]
        d_splats = [torch.empty_like(tensor) for tensor in (means, quats, log_scales, logits)]
        d_sh = torch.empty_like(sh) if colors else means.new_empty(0)
        d_offsets = means.new_empty((count, 2))
        if count:
            d_outputs = [gradient.contiguous() for gradient in gradients[:3]]
            d_pairs = table.new_zeros((len(tiles.slots), kernels.COLUMNS))
            d_table = torch.empty_like(table)
            ranks = torch.full((len(views.sizes) * count,), -1, dtype=torch.int32, device=table.device)
            ranks[index] = torch.arange(len(index), dtype=torch.int32, device=table.device)
            with torch.cuda.device_of(table):
                kernels.blend_tile_backward[(views.tiles,)](
                    table, tiles.owners, tiles.slots, tiles.starts, views.frames, transmittance, last,
                    *d_outputs, d_pairs, len(views.sizes), ALPHA_MAX,
                    num_warps=BACKWARD_WARPS, enable_fp_fusion=True,
                )  # fmt: skip
                if len(table):
                    kernels.sum_pairs[(len(table),)](d_pairs, tiles.ends, d_table, num_warps=1, enable_fp_fusion=True)
                kernels.project_splats_backward[(math.ceil(count / kernels.BLOCK),)](
                    *splats, views.cameras, ranks, d_table, *d_splats, d_sh, d_offsets,
                    count, len(views.sizes), dilation,
                    COEFFICIENTS=coefficients, PADDED=1 << (coefficients - 1).bit_length(), COLORS=colors,
                    num_warps=PROJECT_WARPS,
                )  # fmt: skip
        by_offsets = d_offsets if ctx.needs_input_grad[2] else None
        return None, None, by_offsets, *d_splats, d_sh if colors else None


def rasterize_triton(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    backgrounds: Sequence[Tensor | None],
    screen_offsets: Tensor | None,
) -> list[Render]:
    """Render views with Triton. Arguments as in `studio.rasterizer.rasterize_views`, already validated.

    The same input gives the same bits on the same GPU: no sum depends on the order in which threads run.
    """
    renders: list[Render] = []
    for first in range(0, len(cameras), _VIEWS_AT_ONCE):
        views = Views.of(cameras[first : first + _VIEWS_AT_ONCE], gaussians.means.device)
        splats = (tensor for _, tensor in gaussians.items())
        drawn = _Draw.apply(views, gaussians.dilation, screen_offsets, *splats)
        renders += _pictures(views, backgrounds[first : first + _VIEWS_AT_ONCE], *drawn)
    return renders


def _pictures(
    views: Views,
    backgrounds: Sequence[Tensor | None],
    colors: Tensor,
    weighted_depth: Tensor,
    transmittance: Tensor,
    radii: Tensor,
) -> list[Render]:
    """The renders of the views, from the pixels of all of them."""
    alphas = 1 - transmittance
    depths = mean_depth(weighted_depth, alphas)
    pixels = [width * height for width, height in views.sizes]
    parts = (tensor.split(pixels) for tensor in (colors, transmittance, alphas, depths))
    renders = []
    for (width, height), behind, of_splats, *parts_of_view in zip(views.sizes, backgrounds, radii, *parts, strict=True):
        color, through, alpha, depth = (part.view(height, width, *part.shape[1:]) for part in parts_of_view)
        image = color if behind is None else color + through[..., None] * behind
        renders.append(Render(image=image, alpha=alpha, depth=depth, radii=of_splats))
    return renders
