"""The Triton backend: tile-wise blending on an NVIDIA GPU without nvcc, in float32.

Triton compiles the kernels of `triton_kernels.py` when they are first used, with the assembler in its own package, in
seconds. PyTorch's CUDA builds for Linux install it. It is imported only here.

Projection, spherical harmonics and their gradients are the reference's torch operations: they are done once per splat,
not once per pixel and splat. Binning is torch, too: splats are sorted by depth, then their pairs with tiles stably by
tile, so that splats of equal depth keep their order. A pass waits for the GPU once, for the numbers of drawn splats and
of pairs.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.rasterizer.cuda import camera_tensors
from studio.rasterizer.reference import project, visible_radii
from studio.rasterizer.types import Pinhole, Render

FORWARD_WARPS, BACKWARD_WARPS = 4, 1
"""Warps per tile. One for the gradient: its ten sums per splat then need no synchronization between warps."""


def load_triton_kernels() -> Any:
    """The module `studio.rasterizer.triton_kernels`.

    Raises:
        StudioError: `rasterizer.triton_missing`: Triton is not installed or fails to import.
    """
    try:
        return importlib.import_module("studio.rasterizer.triton_kernels")
    except ImportError as error:
        raise StudioError(
            "rasterizer.triton_missing",
            f"Triton cannot be imported ({error})",
            fix="Reinstall a CUDA build of PyTorch for Linux, which installs it, or use backend='cpu'",
        ) from error


@dataclass(frozen=True)
class Tiles:
    """Pairs (tile, splat) of V drawn splats, sorted by tile and then by depth.

    Attributes:
        width, height: image size, pixels.
        across, down: tiles in a row and in a column.
        owners: (P,) int32, the splat of each pair.
        slots: (P,) int64, number of each pair when sorted by splat.
        starts: (tiles + 1,) int64, first pair of each tile.
        ends: (V,) int64, one past the last pair of each splat when sorted by splat.
    """

    width: int
    height: int
    across: int
    down: int
    owners: Tensor
    slots: Tensor
    starts: Tensor
    ends: Tensor


@torch.no_grad()
def bin_splats(
    means2d: Tensor, half: Tensor, depths: Tensor, width: int, height: int, size: int
) -> tuple[Tensor, Tiles]:
    """Assign splats to the tiles that their boxes overlap.

    Args:
        means2d: (N, 2) centers of the boxes, pixels.
        half: (N, 2) half sizes, pixels; 0 for splats that are not drawn.
        depths: (N,) world units.
        width, height: image size, pixels.
        size: tile size, pixels.

    Returns:
        (V,) indices of the drawn splats, nearest first; and their tiles.
    """
    across, down = math.ceil(width / size), math.ceil(height / size)
    shown = half[:, 0] > 0
    # A tile is overlapped if its left edge is below `high` and its right edge above `low`; the same for rows. Clamped
    # before the conversion, since a box may be larger than any integer.
    low, high = (means2d - half) / size, (means2d + half) / size
    first_x, last_x = low[:, 0].floor().clamp(0, across), high[:, 0].ceil().clamp(0, across)
    first_y, last_y = low[:, 1].floor().clamp(0, down), high[:, 1].ceil().clamp(0, down)
    boxes = torch.stack([first_x, first_y, last_x - first_x, last_y - first_y], -1)
    boxes = torch.where(shown[:, None], boxes, 0.0).long()
    counts = boxes[:, 2] * boxes[:, 3]
    drawn, total = torch.stack([shown.sum(), counts.sum()]).tolist()  # the one wait

    farthest = torch.finfo(depths.dtype).max  # of what is drawn, if a depth overflows
    index = torch.sort(torch.where(shown, depths.clamp_max(farthest), math.inf), stable=True).indices[:drawn]
    boxes, counts = boxes[index], counts[index]
    ends = counts.cumsum(0)
    owners = torch.repeat_interleave(counts, output_size=total)
    within = torch.arange(total, device=half.device) - (ends - counts)[owners]
    left, top, columns, _ = boxes[owners].unbind(-1)
    tiles = (top + within // columns) * across + left + within % columns
    narrow = torch.int16 if across * down < 2**15 else torch.int32  # fewer digits to sort by
    tiles, slots = torch.sort(tiles.to(narrow), stable=True)
    edges = torch.arange(across * down + 1, device=half.device, dtype=torch.int32)
    starts = torch.searchsorted(tiles.int(), edges)
    return index, Tiles(width, height, across, down, owners[slots].int(), slots, starts, ends)


class _Blend(torch.autograd.Function):
    """forward(table, tiles, alpha_max) -> sum of weighted colors, sum of weighted depths, transmittance."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, tiles: Tiles, alpha_max: float) -> tuple[Tensor, Tensor, Tensor]:
        kernels = load_triton_kernels()
        table = table.detach().contiguous()
        image = table.new_empty((tiles.height, tiles.width, 3))
        depth, transmittance = image.new_empty(image.shape[:2]), image.new_empty(image.shape[:2])
        last = torch.empty_like(depth, dtype=torch.int32)
        size = (tiles.width, tiles.height, tiles.across, alpha_max)
        with torch.cuda.device_of(table):
            kernels.blend_tile[(tiles.across * tiles.down,)](
                table,
                tiles.owners,
                tiles.starts,
                image,
                depth,
                transmittance,
                last,
                *size,
                num_warps=FORWARD_WARPS,
                enable_fp_fusion=True,
            )
        ctx.tiles, ctx.size = tiles, size
        ctx.save_for_backward(table, transmittance, last)
        return image, depth, transmittance

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        kernels, tiles = load_triton_kernels(), ctx.tiles
        table, transmittance, last = ctx.saved_tensors
        d_table = torch.empty_like(table)
        if len(table):
            d_outputs = [gradient.contiguous() for gradient in gradients]
            d_pairs = table.new_zeros((len(tiles.slots), kernels.COLUMNS))
            with torch.cuda.device_of(table):
                kernels.blend_tile_backward[(tiles.across * tiles.down,)](
                    table,
                    tiles.owners,
                    tiles.slots,
                    tiles.starts,
                    transmittance,
                    last,
                    *d_outputs,
                    d_pairs,
                    *ctx.size,
                    num_warps=BACKWARD_WARPS,
                    enable_fp_fusion=True,
                )
                kernels.sum_pairs[(len(table),)](d_pairs, tiles.ends, d_table, num_warps=1, enable_fp_fusion=True)
        return d_table, None, None


def rasterize_triton(
    gaussians: Gaussians,
    pinhole: Pinhole,
    background: Tensor | None,
    screen_offsets: Tensor | None,
    near: float,
    alpha_max: float,
) -> Render:
    """Render with Triton. Arguments as in `studio.rasterizer.rasterize`, already validated.

    The same input gives the same bits on the same GPU: no sum depends on the order in which threads run.

    Raises:
        StudioError: `rasterizer.dtype`: the splats are not float32; `rasterizer.mixed_tensors`: `screen_offsets` has
            another device or dtype than the splats; `rasterizer.triton_missing`: as `load_triton_kernels`.
    """
    like = gaussians.means
    if like.dtype != torch.float32:
        raise StudioError(
            "rasterizer.dtype",
            f"the triton rasterizer supports float32, not {like.dtype}",
            value=str(like.dtype),
            fix="Convert the splats, or use backend='reference'",
        )
    if screen_offsets is not None and (screen_offsets.dtype != like.dtype or screen_offsets.device != like.device):
        raise StudioError(
            "rasterizer.mixed_tensors",
            f"screen_offsets is {screen_offsets.dtype} on '{screen_offsets.device}', but the splats are "
            f"{like.dtype} on '{like.device}'",
            argument="screen_offsets",
        )
    kernels = load_triton_kernels()
    view = camera_tensors(pinhole, like.device)
    pose = (view.world_to_camera[:3, :3], view.world_to_camera[:3, 3], view.center)
    half, all_depths, centers = visible_radii(gaussians, pinhole, screen_offsets, near, pose)
    index, tiles = bin_splats(centers, half, all_depths, pinhole.width, pinhole.height, kernels.TILE)

    # Only what is drawn, so that values that are not finite and splats behind the camera reach no gradient.
    splats = gaussians.map(lambda tensor: tensor.index_select(0, index))
    means2d, cov2d, det, depths, colors = project(splats, pinhole, pose)
    if screen_offsets is not None:
        means2d = means2d + screen_offsets.index_select(0, index)
    conics = torch.stack([cov2d[:, 2], -cov2d[:, 1], cov2d[:, 0]], -1) / det[:, None]
    table = torch.cat([means2d, conics, splats.opacities[:, None], colors, depths[:, None]], -1)
    image, weighted_depth, transmittance = _Blend.apply(table, tiles, alpha_max)

    if background is not None:
        image = image + transmittance[..., None] * background
    alpha = 1 - transmittance
    covered = alpha > 0
    depth = torch.where(covered, weighted_depth / torch.where(covered, alpha, torch.ones_like(alpha)), 0.0)
    return Render(image=image, alpha=alpha, depth=depth, radii=half.amax(-1))
