"""The kernels of the Triton backend (`triton_backend.py`): blending of a tile, its gradient, and sums over tiles.

One program draws one tile of one of the views of a call. Tiles and pixels are numbered through all views. The splats of
a tile are pairs (tile, splat), sorted by tile and then by depth; `owners` maps a pair to its splat. The splats are rows
of a table: 2D mean x and y, conic xx, xy and yy, opacity, red, green, blue, depth.

No kernel uses atomic operations, so that the same input gives the same bits: the gradients of each pair have a row of
their own, and `sum_pairs` adds the rows of a splat in a fixed order.

With TRITON_INTERPRET=1, set before Triton is imported, the same code runs on the CPU.
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
from __future__ import annotations

import triton
import triton.language as tl

from studio.rasterizer.types import ALPHA_MIN, TRANSMITTANCE_MIN

TILE = 16  # tile size, pixels
COLUMNS = 10  # columns of the table of splats
CAMERA = 32  # numbers that describe a view, see `Views` of `triton_backend.py`

_TILE = tl.constexpr(TILE)
_CAMERA = tl.constexpr(CAMERA)
_COLUMNS = tl.constexpr(COLUMNS)
_COLUMNS_PADDED = tl.constexpr(16)  # Triton's blocks have powers of two as sizes
_CHUNK = tl.constexpr(32)  # splats between two checks whether all pixels of a tile have stopped
_ROWS = tl.constexpr(16)
_ALPHA_MIN = tl.constexpr(ALPHA_MIN)
_TRANSMITTANCE_MIN = tl.constexpr(TRANSMITTANCE_MIN)


@triton.jit
def _pixels(tile, frames, views):
    """Centers of a tile's pixels, their numbers among the pixels of all views, and which of them are in the image."""
    view = 0
    for number in range(1, views):  # the last view whose first tile is not after this one
        view = tl.where(tl.load(frames + number * _CAMERA + 24) <= tile, number, view)
    frame = frames + view * _CAMERA
    width = tl.load(frame + 25)
    within = tile - tl.load(frame + 24)
    across = tl.load(frame + 27)
    number = tl.arange(0, _TILE * _TILE)
    column = (within % across) * _TILE + number % _TILE
    row = (within // across) * _TILE + number // _TILE
    inside = (column < width) & (row < tl.load(frame + 26))
    pixel = tl.load(frame + 29) + row.to(tl.int64) * width + column
    return column.to(tl.float32) + 0.5, row.to(tl.float32) + 0.5, pixel, inside


@triton.jit
def _falloff(splat, x, y):
    """Offsets of pixels from a splat's mean, sigma, and exp(-sigma)."""
    dx = x - tl.load(splat)
    dy = y - tl.load(splat + 1)
    sigma = 0.5 * (tl.load(splat + 2) * dx * dx + tl.load(splat + 4) * dy * dy) + tl.load(splat + 3) * dx * dy
    return dx, dy, sigma, tl.exp(-tl.maximum(sigma, 0.0))


@triton.jit
def blend_tile(
    table, owners, starts, frames, image, depth, transmittance, last, views, alpha_max
):  # fmt: skip
    """Blend the splats of a tile, nearest first.

    Args:
        table: (V, 10) float32, see above.
        owners: (P,) int32, row of the table for each pair.
        starts: (tiles + 1,) int64, first pair of each tile.
        frames: (V, 32) int32, the views.
        image: (pixels, 3) float32, output: sum of weight times color.
        depth: (pixels,) float32, output: sum of weight times depth.
        transmittance: (pixels,) float32, output.
        last: (pixels,) int32, output: pairs of the tile up to and including the last one that was drawn.
        views, alpha_max: V, and the upper clamp of alpha.
    """
    tile = tl.program_id(0)
    x, y, pixel, inside = _pixels(tile, frames, views)
    start = tl.load(starts + tile)
    end = tl.load(starts + tile + 1)
    through = tl.full([_TILE * _TILE], 1.0, tl.float32)
    red = tl.zeros([_TILE * _TILE], tl.float32)
    green = tl.zeros([_TILE * _TILE], tl.float32)
    blue = tl.zeros([_TILE * _TILE], tl.float32)
    far = tl.zeros([_TILE * _TILE], tl.float32)
    drawn_last = tl.zeros([_TILE * _TILE], tl.int32)
    going = inside.to(tl.int32)
    position = start
    alive = 1
    while (position < end) & (alive > 0):
        stop = tl.minimum(position + _CHUNK, end)
        for pair in range(position, stop):
            splat = table + tl.load(owners + pair) * _COLUMNS
            _, _, _, falloff = _falloff(splat, x, y)
            alpha = tl.minimum(tl.load(splat + 5) * falloff, alpha_max)
            after = through * (1.0 - alpha)
            visible = (alpha >= _ALPHA_MIN) & (going > 0)
            drawn = visible & (after > _TRANSMITTANCE_MIN)
            going = tl.where(visible & (after <= _TRANSMITTANCE_MIN), 0, going)
            weight = tl.where(drawn, alpha * through, 0.0)
            red += weight * tl.load(splat + 6)
            green += weight * tl.load(splat + 7)
            blue += weight * tl.load(splat + 8)
            far += weight * tl.load(splat + 9)
            through = tl.where(drawn, after, through)
            drawn_last = tl.where(drawn, (pair - start + 1).to(tl.int32), drawn_last)
        alive = tl.max(going, axis=0)
        position = stop
    tl.store(image + pixel * 3, red, mask=inside)
    tl.store(image + pixel * 3 + 1, green, mask=inside)
    tl.store(image + pixel * 3 + 2, blue, mask=inside)
    tl.store(depth + pixel, far, mask=inside)
    tl.store(transmittance + pixel, through, mask=inside)
    tl.store(last + pixel, drawn_last, mask=inside)


@triton.jit
def blend_tile_backward(
    table, owners, slots, starts, frames, transmittance, last, d_image, d_depth, d_transmittance, d_pairs,
    views, alpha_max,
):  # fmt: skip
    """The gradient of `blend_tile`, from the last splat that was drawn to the first.

    Args:
        slots: (P,) int64, row of `d_pairs` for each pair.
        transmittance, last: as written by `blend_tile`.
        d_pairs: (P, 10) float32, output: the gradient of the table's row, from this tile's pixels. Rows of splats that
            were not drawn in the tile are left as they are: fill it with zeros.
        table, owners, starts, frames, views, alpha_max: as in `blend_tile`.
    """
    tile = tl.program_id(0)
    x, y, pixel, inside = _pixels(tile, frames, views)
    start = tl.load(starts + tile)
    through = tl.load(transmittance + pixel, mask=inside, other=1.0)
    drawn_last = tl.load(last + pixel, mask=inside, other=0)
    d_red = tl.load(d_image + pixel * 3, mask=inside, other=0.0)
    d_green = tl.load(d_image + pixel * 3 + 1, mask=inside, other=0.0)
    d_blue = tl.load(d_image + pixel * 3 + 2, mask=inside, other=0.0)
    d_far = tl.load(d_depth + pixel, mask=inside, other=0.0)
    # What lies behind a splat: sum of weight times value, where the value is the gradient of the loss by the weight.
    behind = through * tl.load(d_transmittance + pixel, mask=inside, other=0.0)
    count = tl.max(drawn_last, axis=0)
    for step in range(count):
        number = count - 1 - step
        pair = start + number
        splat = table + tl.load(owners + pair) * _COLUMNS
        dx, dy, sigma, falloff = _falloff(splat, x, y)
        opacity = tl.load(splat + 5)
        alpha = tl.minimum(opacity * falloff, alpha_max)
        drawn = (alpha >= _ALPHA_MIN) & (number < drawn_last)
        if tl.max(drawn.to(tl.int32), axis=0) > 0:
            alpha = tl.where(drawn, alpha, 0.0)
            rest = 1.0 - alpha
            before = through / rest
            weight = alpha * before
            value = d_red * tl.load(splat + 6) + d_green * tl.load(splat + 7)
            value += d_blue * tl.load(splat + 8) + d_far * tl.load(splat + 9)
            d_alpha = before * value - behind / rest
            d_alpha = tl.where(drawn & (opacity * falloff <= alpha_max), d_alpha, 0.0)
            d_sigma = tl.where(sigma >= 0.0, -opacity * falloff * d_alpha, 0.0)
            behind += weight * value
            through = before
            xx = tl.load(splat + 2)
            xy = tl.load(splat + 3)
            yy = tl.load(splat + 4)
            row = d_pairs + tl.load(slots + pair) * _COLUMNS
            tl.store(row, -tl.sum(d_sigma * (xx * dx + xy * dy), axis=0))
            tl.store(row + 1, -tl.sum(d_sigma * (xy * dx + yy * dy), axis=0))
            tl.store(row + 2, tl.sum(d_sigma * 0.5 * dx * dx, axis=0))
            tl.store(row + 3, tl.sum(d_sigma * dx * dy, axis=0))
            tl.store(row + 4, tl.sum(d_sigma * 0.5 * dy * dy, axis=0))
            tl.store(row + 5, tl.sum(d_alpha * falloff, axis=0))
            tl.store(row + 6, tl.sum(weight * d_red, axis=0))
            tl.store(row + 7, tl.sum(weight * d_green, axis=0))
            tl.store(row + 8, tl.sum(weight * d_blue, axis=0))
            tl.store(row + 9, tl.sum(weight * d_far, axis=0))


@triton.jit
def sum_pairs(d_pairs, ends, d_table):
    """Add the adjacent rows of each splat: (P, 10) float32 to (V, 10); `ends`, (V,) int64: one past its last row."""
    splat = tl.program_id(0).to(tl.int64)
    start = tl.load(ends + splat - 1, mask=splat > 0, other=0)
    end = tl.load(ends + splat)
    rows = tl.arange(0, _ROWS)
    columns = tl.arange(0, _COLUMNS_PADDED)
    total = tl.zeros([_ROWS, _COLUMNS_PADDED], tl.float32)
    for first in range(start, end, _ROWS):
        mask = (first + rows < end)[:, None] & (columns < _COLUMNS)[None, :]
        total += tl.load(d_pairs + (first + rows)[:, None] * _COLUMNS + columns[None, :], mask=mask, other=0.0)
    tl.store(d_table + splat * _COLUMNS + columns, tl.sum(total, axis=0), mask=columns < _COLUMNS)
