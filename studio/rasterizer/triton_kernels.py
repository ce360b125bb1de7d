"""The kernels of the Triton backend (`triton_backend.py`): projecting splats, blending tiles, and gradients of both.

Per splat, they compute `project` and `visible_radii` of `reference.py` for all views of a call. V views and N splats
make V N places, view by view. What a splat looks like in a view is a row of a table: 2D mean x and y, conic xx, xy and
yy, opacity, red, green, blue, depth. A camera is a row of 32 numbers, see `Views` of `triton_backend.py`.

For blending, one program draws one tile of one of the views. Tiles and pixels are numbered through all views. The
splats of a tile are pairs (tile, splat), sorted by tile and then by depth; `owners` maps a pair to its splat.

No kernel uses atomic operations, so that the same input gives the same bits: the gradients of each pair have a row of
their own, and `sum_pairs` adds the rows of a splat in a fixed order. The gradient of a splat is summed over the views
in their order, by one thread.

With TRITON_INTERPRET=1, set before Triton is imported, the same code runs on the CPU.
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
import triton
import triton.language as tl

from v3studio.studio.rasterizer.types import ALPHA_MIN, TRANSMITTANCE_MIN

TILE = 16  # tile size, pixels
COLUMNS = 10  # columns of the table of splats
BLOCK = 128  # splats of a program that projects

_TILE = tl.constexpr(TILE)
_CAMERA = tl.constexpr(32)  # numbers that describe a view
_COLUMNS = tl.constexpr(COLUMNS)
_BLOCK = tl.constexpr(BLOCK)
_COLUMNS_PADDED = tl.constexpr(16)  # Triton's blocks have powers of two as sizes
_CHUNK = tl.constexpr(32)  # splats between two checks whether all pixels of a tile have stopped
_ROWS = tl.constexpr(16)
_ALPHA_MIN = tl.constexpr(ALPHA_MIN)
_TRANSMITTANCE_MIN = tl.constexpr(TRANSMITTANCE_MIN)
_INFINITY = tl.constexpr(float("inf"))


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


@triton.jit
def _finite(value):
    return tl.abs(value) < _INFINITY


@triton.jit
def _triple(pointer, index, mask):
    """The three numbers of a row."""
    x = tl.load(pointer + index * 3, mask=mask, other=0.0)
    y = tl.load(pointer + index * 3 + 1, mask=mask, other=0.0)
    return x, y, tl.load(pointer + index * 3 + 2, mask=mask, other=0.0)


@triton.jit
def _unit_quat(quats, index, mask):
    """A quaternion of norm 1, and the norm that it had."""
    w = tl.load(quats + index * 4, mask=mask, other=1.0)
    x = tl.load(quats + index * 4 + 1, mask=mask, other=0.0)
    y = tl.load(quats + index * 4 + 2, mask=mask, other=0.0)
    z = tl.load(quats + index * 4 + 3, mask=mask, other=0.0)
    length = tl.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length, length


@triton.jit
def _local(camera, x, y, z):
    """A point in the camera's axes."""
    across = tl.load(camera) * x + tl.load(camera + 1) * y + tl.load(camera + 2) * z + tl.load(camera + 9)
    down = tl.load(camera + 3) * x + tl.load(camera + 4) * y + tl.load(camera + 5) * z + tl.load(camera + 10)
    depth = tl.load(camera + 6) * x + tl.load(camera + 7) * y + tl.load(camera + 8) * z + tl.load(camera + 11)
    return across, down, depth


@triton.jit
def _direction(camera, x, y, z):
    """Unit vector from the camera to a point, and the distance."""
    x -= tl.load(camera + 12)
    y -= tl.load(camera + 13)
    z -= tl.load(camera + 14)
    distance = tl.maximum(tl.sqrt(x * x + y * y + z * z), 1e-12)
    return x / distance, y / distance, z / distance, distance


@triton.jit
def _clamped(value, camera, limit: tl.constexpr):
    """x / z or y / z at which the projection is linearized, and whether that is the splat's own."""
    low = tl.load(camera + limit)
    high = tl.load(camera + limit + 1)
    return tl.minimum(tl.maximum(value, low), high), (value >= low) & (value <= high)


@triton.jit
def _axis(plane_x, plane_y, plane_z, w, x, y, z):
    """(Jacobian times world_to_camera) times the splat's rotation: one row."""
    first = plane_x * (1.0 - 2.0 * (y * y + z * z)) + plane_y * 2.0 * (x * y + w * z) + plane_z * 2.0 * (x * z - w * y)
    second = plane_x * 2.0 * (x * y - w * z) + plane_y * (1.0 - 2.0 * (x * x + z * z)) + plane_z * 2.0 * (y * z + w * x)
    third = plane_x * 2.0 * (x * z + w * y) + plane_y * 2.0 * (y * z - w * x) + plane_z * (1.0 - 2.0 * (x * x + y * y))
    return first, second, third


@triton.jit
def _planes(camera, x_lim, y_lim, inverse):
    """The rows of the Jacobian times world_to_camera: those of the image's x and y."""
    a = tl.load(camera + 15) * inverse
    b = tl.load(camera + 16) * inverse
    far_x = tl.load(camera + 6)
    far_y = tl.load(camera + 7)
    far_z = tl.load(camera + 8)
    return (
        a * (tl.load(camera) - x_lim * far_x),
        a * (tl.load(camera + 1) - x_lim * far_y),
        a * (tl.load(camera + 2) - x_lim * far_z),
        b * (tl.load(camera + 3) - y_lim * far_x),
        b * (tl.load(camera + 4) - y_lim * far_y),
        b * (tl.load(camera + 5) - y_lim * far_z),
    )


@triton.jit
def _covariance(u1, u2, u3, v1, v2, v3, dilation):
    """Dilated 2D covariance of the rows u and v of its factor, its determinant, and u x v.

    The determinant without dilation is |u x v|^2 (Lagrange); xx yy - xy^2 would cancel for needle-shaped splats.
    """
    uu = u1 * u1 + u2 * u2 + u3 * u3
    vv = v1 * v1 + v2 * v2 + v3 * v3
    c1 = u2 * v3 - u3 * v2
    c2 = u3 * v1 - u1 * v3
    c3 = u1 * v2 - u2 * v1
    det = c1 * c1 + c2 * c2 + c3 * c3 + dilation * (uu + vv) + dilation * dilation
    return uu + dilation, u1 * v1 + u2 * v2 + u3 * v3, vv + dilation, det, c1, c2, c3


@triton.jit
def _harmonic(x, y, z, NUMBER: tl.constexpr):
    """A basis function of `spherical_harmonics.py`, and its derivatives by x, y and z."""
    value = x * 0.0 + 0.28209479177387814
    dx = x * 0.0
    dy = x * 0.0
    dz = x * 0.0
    if NUMBER == 1:
        value = -0.4886025119029199 * y
        dy = x * 0.0 - 0.4886025119029199
    elif NUMBER == 2:
        value = 0.4886025119029199 * z
        dz = x * 0.0 + 0.4886025119029199
    elif NUMBER == 3:
        value = -0.4886025119029199 * x
        dx = x * 0.0 - 0.4886025119029199
    elif NUMBER == 4:
        value = 1.0925484305920792 * x * y
        dx = 1.0925484305920792 * y
        dy = 1.0925484305920792 * x
    elif NUMBER == 5:
        value = -1.0925484305920792 * y * z
        dy = -1.0925484305920792 * z
        dz = -1.0925484305920792 * y
    elif NUMBER == 6:
        value = 0.31539156525252005 * (3.0 * z * z - 1.0)
        dz = 1.8923493915151203 * z
    elif NUMBER == 7:
        value = -1.0925484305920792 * x * z
        dx = -1.0925484305920792 * z
        dz = -1.0925484305920792 * x
    elif NUMBER == 8:
        value = 0.5462742152960396 * (x * x - y * y)
        dx = 1.0925484305920792 * x
        dy = -1.0925484305920792 * y
    elif NUMBER == 9:
        value = -0.5900435899266435 * y * (3.0 * x * x - y * y)
        dx = -3.540261539559861 * x * y
        dy = -1.7701307697799305 * (x * x - y * y)
    elif NUMBER == 10:
        value = 2.890611442640554 * x * y * z
        dx = 2.890611442640554 * y * z
        dy = 2.890611442640554 * x * z
        dz = 2.890611442640554 * x * y
    elif NUMBER == 11:
        value = -0.4570457994644658 * y * (5.0 * z * z - 1.0)
        dy = -0.4570457994644658 * (5.0 * z * z - 1.0)
        dz = -4.570457994644658 * y * z
    elif NUMBER == 12:
        value = 0.3731763325901154 * z * (5.0 * z * z - 3.0)
        dz = 0.3731763325901154 * (15.0 * z * z - 3.0)
    elif NUMBER == 13:
        value = -0.4570457994644658 * x * (5.0 * z * z - 1.0)
        dx = -0.4570457994644658 * (5.0 * z * z - 1.0)
        dz = -4.570457994644658 * x * z
    elif NUMBER == 14:
        value = 1.445305721320277 * z * (x * x - y * y)
        dx = 2.890611442640554 * x * z
        dy = -2.890611442640554 * y * z
        dz = 1.445305721320277 * (x * x - y * y)
    elif NUMBER == 15:
        value = -0.5900435899266435 * x * (x * x - 3.0 * y * y)
        dx = -1.7701307697799305 * (x * x - y * y)
        dy = 3.540261539559861 * x * y
    return value, dx, dy, dz


@triton.jit
def _color(sh, splat, mask, x, y, z, COEFFICIENTS: tl.constexpr):
    """The color in a direction, and whether it and its coefficients are finite."""
    red = tl.full([_BLOCK], 0.5, tl.float32)
    green = tl.full([_BLOCK], 0.5, tl.float32)
    blue = tl.full([_BLOCK], 0.5, tl.float32)
    finite = mask
    for number in tl.static_range(COEFFICIENTS):
        basis, _, _, _ = _harmonic(x, y, z, number)
        of_red, of_green, of_blue = _triple(sh, splat * COEFFICIENTS + number, mask)
        finite &= _finite(of_red) & _finite(of_green) & _finite(of_blue)
        red += basis * of_red
        green += basis * of_green
        blue += basis * of_blue
    return red, green, blue, finite & _finite(red) & _finite(green) & _finite(blue)


@triton.jit
def project_splats(
    means, quats, log_scales, logits, sh, offsets, cameras, frames, table, half, boxes, keys,
    count, near, dilation,
    COEFFICIENTS: tl.constexpr, OFFSETS: tl.constexpr,
):  # fmt: skip
    """Compute the shape of each splat in each view, and the tiles of its box.

    Args:
        means, quats, log_scales, logits, sh: of `Gaussians`, float32.
        offsets: (N, 2) float32, added to the 2D means if OFFSETS.
        cameras, frames: (V, 32) float32 and int32, the same memory, see above.
        table: (V N, 10) float32, output.
        half: (V N, 2) float32, output: half sizes of the boxes in pixels; 0 for splats that are not drawn.
        boxes: (V N, 4) int32, output: first tile, tiles from one row of the box to the next, its columns, and its
            tiles; 0 tiles for splats that are not drawn.
        keys: (V N,) int64, output: what to sort by, so that the drawn splats come first, view by view, by depth.
        count, near, dilation: N, near plane in world units, and dilation in square pixels.
        COEFFICIENTS: of the spherical harmonics, 1, 4, 9 or 16.
    """
    view = tl.program_id(1)
    camera = cameras + view * _CAMERA
    frame = frames + view * _CAMERA
    splat = tl.program_id(0) * _BLOCK + tl.arange(0, _BLOCK)
    inside = splat < count
    splat = splat.to(tl.int64)
    x, y, z = _triple(means, splat, inside)
    scale_x, scale_y, scale_z = _triple(log_scales, splat, inside)
    shown = inside & _finite(x) & _finite(y) & _finite(z) & _finite(scale_x) & _finite(scale_y) & _finite(scale_z)
    scale_x = tl.exp(scale_x)
    scale_y = tl.exp(scale_y)
    scale_z = tl.exp(scale_z)
    qw, qx, qy, qz, length = _unit_quat(quats, splat, inside)
    # a part that is not finite makes a product of it so, but for 0 / inf where another one is infinite
    shown &= (length > 0.0) & _finite(qw) & _finite(qx) & _finite(qy) & _finite(qz)

    local_x, local_y, depth = _local(camera, x, y, z)
    x_z = local_x / depth
    y_z = local_y / depth
    x_lim, _ = _clamped(x_z, camera, 19)
    y_lim, _ = _clamped(y_z, camera, 21)
    u1, u2, u3, v1, v2, v3 = _planes(camera, x_lim, y_lim, 1.0 / depth)
    u1, u2, u3 = _axis(u1, u2, u3, qw, qx, qy, qz)
    v1, v2, v3 = _axis(v1, v2, v3, qw, qx, qy, qz)
    xx, xy, yy, det, _, _, _ = _covariance(
        u1 * scale_x, u2 * scale_y, u3 * scale_z, v1 * scale_x, v2 * scale_y, v3 * scale_z, dilation
    )
    at_x = tl.load(camera + 15) * x_z + tl.load(camera + 17)
    at_y = tl.load(camera + 16) * y_z + tl.load(camera + 18)
    if OFFSETS:
        at_x += tl.load(offsets + splat * 2, mask=inside, other=0.0)
        at_y += tl.load(offsets + splat * 2 + 1, mask=inside, other=0.0)
    opacity = 1.0 / (1.0 + tl.exp(-tl.load(logits + splat, mask=inside, other=0.0)))
    reach = tl.sqrt(2.0 * tl.log(tl.maximum(opacity / _ALPHA_MIN, 1.0)))
    half_x = reach * tl.sqrt(xx)
    half_y = reach * tl.sqrt(yy)
    shown &= (depth >= near) & (opacity >= _ALPHA_MIN) & _finite(det) & (det > 0.0)
    shown &= _finite(half_x) & _finite(half_y) & _finite(at_x) & _finite(at_y)
    width = tl.load(frame + 25)
    height = tl.load(frame + 26)
    shown &= (at_x + half_x > 0.0) & (at_y + half_y > 0.0) & (at_x - half_x < width) & (at_y - half_y < height)

    to_x, to_y, to_z, _ = _direction(camera, x, y, z)
    red, green, blue, finite = _color(sh, splat, inside, to_x, to_y, to_z, COEFFICIENTS)
    shown &= finite

    place = view.to(tl.int64) * count + splat
    row = table + place * _COLUMNS
    tl.store(row, at_x, mask=inside)
    tl.store(row + 1, at_y, mask=inside)
    tl.store(row + 2, yy / det, mask=inside)
    tl.store(row + 3, -xy / det, mask=inside)
    tl.store(row + 4, xx / det, mask=inside)
    tl.store(row + 5, opacity, mask=inside)
    tl.store(row + 6, tl.maximum(red, 0.0), mask=inside)
    tl.store(row + 7, tl.maximum(green, 0.0), mask=inside)
    tl.store(row + 8, tl.maximum(blue, 0.0), mask=inside)
    tl.store(row + 9, depth, mask=inside)
    tl.store(half + place * 2, tl.where(shown, half_x, 0.0), mask=inside)
    tl.store(half + place * 2 + 1, tl.where(shown, half_y, 0.0), mask=inside)

    # A tile is overlapped if its left edge is below the box's right one and its right edge above the left one; the same
    # for rows. Clamped before the conversion, since a box may be larger than any integer.
    across = tl.load(frame + 27)
    down = tl.load(frame + 28)
    left = tl.minimum(tl.maximum(tl.floor((at_x - half_x) / _TILE), 0.0), across.to(tl.float32))
    right = tl.minimum(tl.maximum(tl.ceil((at_x + half_x) / _TILE), 0.0), across.to(tl.float32))
    top = tl.minimum(tl.maximum(tl.floor((at_y - half_y) / _TILE), 0.0), down.to(tl.float32))
    bottom = tl.minimum(tl.maximum(tl.ceil((at_y + half_y) / _TILE), 0.0), down.to(tl.float32))
    left = tl.where(shown, left, 0.0).to(tl.int32)
    top = tl.where(shown, top, 0.0).to(tl.int32)
    columns = tl.where(shown, right, 0.0).to(tl.int32) - left
    rows = tl.where(shown, bottom, 0.0).to(tl.int32) - top
    box = boxes + place * 4
    tl.store(box, tl.load(frame + 24) + top * across + left, mask=inside)
    tl.store(box + 1, across + left * 0, mask=inside)
    tl.store(box + 2, columns, mask=inside)
    tl.store(box + 3, columns * rows, mask=inside)
    # The bits of floats above 0 have the order of the floats.
    by_depth = (view.to(tl.int64) << 32) | tl.where(shown, depth, 0.0).to(tl.int32, bitcast=True).to(tl.int64)
    tl.store(keys + place, tl.where(shown, by_depth, 0x7FFFFFFFFFFFFFFF), mask=inside)


@triton.jit
def project_splats_backward(
    means, quats, log_scales, logits, sh, cameras, ranks, d_table,
    d_means, d_quats, d_log_scales, d_logits, d_sh, d_offsets,
    count, views, dilation,
    COEFFICIENTS: tl.constexpr, PADDED: tl.constexpr, COLORS: tl.constexpr,
):  # fmt: skip
    """The gradient of `project_splats`.

    Args:
        ranks: (V N,) int32, row of `d_table` of a place; -1: it was not drawn.
        d_table: (D, 10) float32, gradient of the rows of what was drawn.
        d_means, d_quats, d_log_scales, d_logits: float32, outputs, as the splats' tensors.
        d_sh: the same for the spherical harmonics, if COLORS; else not written.
        d_offsets: (N, 2) float32, output.
        means, quats, log_scales, logits, sh, cameras, count, dilation, COEFFICIENTS: as in `project_splats`.
        PADDED: COEFFICIENTS, padded to a power of two.
    """
    splat = tl.program_id(0) * _BLOCK + tl.arange(0, _BLOCK)
    inside = splat < count
    splat = splat.to(tl.int64)
    x, y, z = _triple(means, splat, inside)
    qw, qx, qy, qz, length = _unit_quat(quats, splat, inside)
    scale_x, scale_y, scale_z = _triple(log_scales, splat, inside)
    scale_x = tl.exp(scale_x)
    scale_y = tl.exp(scale_y)
    scale_z = tl.exp(scale_z)
    opacity = 1.0 / (1.0 + tl.exp(-tl.load(logits + splat, mask=inside, other=0.0)))
    zero = tl.zeros([_BLOCK], tl.float32)
    mean_x = zero
    mean_y = zero
    mean_z = zero
    quat_w = zero
    quat_x = zero
    quat_y = zero
    quat_z = zero
    log_x = zero
    log_y = zero
    log_z = zero
    d_opacity = zero
    offset_x = zero
    offset_y = zero
    coefficient = tl.arange(0, PADDED)
    sh_red = tl.zeros([_BLOCK, PADDED], tl.float32)
    sh_green = tl.zeros([_BLOCK, PADDED], tl.float32)
    sh_blue = tl.zeros([_BLOCK, PADDED], tl.float32)
    camera = cameras
    place = ranks + splat
    for _ in range(views):
        rank = tl.load(place, mask=inside, other=-1)
        drawn = rank >= 0
        row = d_table + rank.to(tl.int64) * _COLUMNS
        d_at_x = tl.load(row, mask=drawn, other=0.0)
        d_at_y = tl.load(row + 1, mask=drawn, other=0.0)
        d_yy = tl.load(row + 2, mask=drawn, other=0.0)
        d_xy = tl.load(row + 3, mask=drawn, other=0.0)
        d_xx = tl.load(row + 4, mask=drawn, other=0.0)
        d_opacity += tl.load(row + 5, mask=drawn, other=0.0)
        d_red = tl.load(row + 6, mask=drawn, other=0.0)
        d_green = tl.load(row + 7, mask=drawn, other=0.0)
        d_blue = tl.load(row + 8, mask=drawn, other=0.0)
        d_depth = tl.load(row + 9, mask=drawn, other=0.0)
        offset_x += d_at_x
        offset_y += d_at_y

        local_x, local_y, depth = _local(camera, x, y, z)
        inverse = 1.0 / depth
        x_z = local_x * inverse
        y_z = local_y * inverse
        x_lim, own_x = _clamped(x_z, camera, 19)
        y_lim, own_y = _clamped(y_z, camera, 21)
        a1, a2, a3, b1, b2, b3 = _planes(camera, x_lim, y_lim, inverse)
        m1, m2, m3 = _axis(a1, a2, a3, qw, qx, qy, qz)
        n1, n2, n3 = _axis(b1, b2, b3, qw, qx, qy, qz)
        u1 = m1 * scale_x
        u2 = m2 * scale_y
        u3 = m3 * scale_z
        v1 = n1 * scale_x
        v2 = n2 * scale_y
        v3 = n3 * scale_z
        xx, xy, yy, det, c1, c2, c3 = _covariance(u1, u2, u3, v1, v2, v3, dilation)

        # the conic is (yy, -xy, xx) / det
        d_det = -(d_yy * yy - d_xy * xy + d_xx * xx) / (det * det)
        d_xx = d_xx / det + dilation * d_det
        d_yy = d_yy / det + dilation * d_det
        d_xy = -d_xy / det
        c1 *= 2.0 * d_det
        c2 *= 2.0 * d_det
        c3 *= 2.0 * d_det
        d_u1 = 2.0 * u1 * d_xx + v1 * d_xy + v2 * c3 - v3 * c2
        d_u2 = 2.0 * u2 * d_xx + v2 * d_xy + v3 * c1 - v1 * c3
        d_u3 = 2.0 * u3 * d_xx + v3 * d_xy + v1 * c2 - v2 * c1
        d_v1 = 2.0 * v1 * d_yy + u1 * d_xy + c2 * u3 - c3 * u2
        d_v2 = 2.0 * v2 * d_yy + u2 * d_xy + c3 * u1 - c1 * u3
        d_v3 = 2.0 * v3 * d_yy + u3 * d_xy + c1 * u2 - c2 * u1
        log_x += tl.where(drawn, d_u1 * u1 + d_v1 * v1, 0.0)
        log_y += tl.where(drawn, d_u2 * u2 + d_v2 * v2, 0.0)
        log_z += tl.where(drawn, d_u3 * u3 + d_v3 * v3, 0.0)
        d_u1 *= scale_x
        d_u2 *= scale_y
        d_u3 *= scale_z
        d_v1 *= scale_x
        d_v2 *= scale_y
        d_v3 *= scale_z

        # by the elements of the splat's rotation, and from there to its quaternion
        r00 = a1 * d_u1 + b1 * d_v1
        r01 = a1 * d_u2 + b1 * d_v2
        r02 = a1 * d_u3 + b1 * d_v3
        r10 = a2 * d_u1 + b2 * d_v1
        r11 = a2 * d_u2 + b2 * d_v2
        r12 = a2 * d_u3 + b2 * d_v3
        r20 = a3 * d_u1 + b3 * d_v1
        r21 = a3 * d_u2 + b3 * d_v2
        r22 = a3 * d_u3 + b3 * d_v3
        d_qw = 2.0 * (qz * (r10 - r01) + qy * (r02 - r20) + qx * (r21 - r12))
        d_qx = 2.0 * (qy * (r01 + r10) + qz * (r02 + r20) + qw * (r21 - r12) - 2.0 * qx * (r11 + r22))
        d_qy = 2.0 * (qx * (r01 + r10) + qz * (r12 + r21) + qw * (r02 - r20) - 2.0 * qy * (r00 + r22))
        d_qz = 2.0 * (qx * (r02 + r20) + qy * (r12 + r21) + qw * (r10 - r01) - 2.0 * qz * (r00 + r11))
        along = qw * d_qw + qx * d_qx + qy * d_qy + qz * d_qz
        quat_w += tl.where(drawn, (d_qw - qw * along) / length, 0.0)
        quat_x += tl.where(drawn, (d_qx - qx * along) / length, 0.0)
        quat_y += tl.where(drawn, (d_qy - qy * along) / length, 0.0)
        quat_z += tl.where(drawn, (d_qz - qz * along) / length, 0.0)

        # by the rows of the Jacobian times world_to_camera: the splat's rotation times d_u and d_v
        d_a1, d_a2, d_a3 = _axis(d_u1, d_u2, d_u3, qw, -qx, -qy, -qz)
        d_b1, d_b2, d_b3 = _axis(d_v1, d_v2, d_v3, qw, -qx, -qy, -qz)
        focal_x = tl.load(camera + 15)
        focal_y = tl.load(camera + 16)
        d_inverse = (d_a1 * a1 + d_a2 * a2 + d_a3 * a3 + d_b1 * b1 + d_b2 * b2 + d_b3 * b3) * depth
        w6 = tl.load(camera + 6)
        w7 = tl.load(camera + 7)
        w8 = tl.load(camera + 8)
        d_x_lim = -focal_x * inverse * (d_a1 * w6 + d_a2 * w7 + d_a3 * w8)
        d_y_lim = -focal_y * inverse * (d_b1 * w6 + d_b2 * w7 + d_b3 * w8)
        d_x_z = focal_x * d_at_x + tl.where(own_x, d_x_lim, 0.0)
        d_y_z = focal_y * d_at_y + tl.where(own_y, d_y_lim, 0.0)
        d_local_x = d_x_z * inverse
        d_local_y = d_y_z * inverse
        d_local_z = d_depth - inverse * (inverse * d_inverse + x_z * d_x_z + y_z * d_y_z)
        d_x = tl.load(camera) * d_local_x + tl.load(camera + 3) * d_local_y + w6 * d_local_z
        d_y = tl.load(camera + 1) * d_local_x + tl.load(camera + 4) * d_local_y + w7 * d_local_z
        d_z = tl.load(camera + 2) * d_local_x + tl.load(camera + 5) * d_local_y + w8 * d_local_z

        to_x, to_y, to_z, distance = _direction(camera, x, y, z)
        red, green, blue, _ = _color(sh, splat, drawn, to_x, to_y, to_z, COEFFICIENTS)
        d_red = tl.where(red >= 0.0, d_red, 0.0)
        d_green = tl.where(green >= 0.0, d_green, 0.0)
        d_blue = tl.where(blue >= 0.0, d_blue, 0.0)
        d_to_x = zero
        d_to_y = zero
        d_to_z = zero
        for number in tl.static_range(COEFFICIENTS):
            basis, by_x, by_y, by_z = _harmonic(to_x, to_y, to_z, number)
            if number > 0:
                of_red, of_green, of_blue = _triple(sh, splat * COEFFICIENTS + number, drawn)
                d_basis = of_red * d_red + of_green * d_green + of_blue * d_blue
                d_to_x += by_x * d_basis
                d_to_y += by_y * d_basis
                d_to_z += by_z * d_basis
            if COLORS:
                here = (coefficient == number)[None, :] & drawn[:, None]
                sh_red += tl.where(here, (basis * d_red)[:, None], 0.0)
                sh_green += tl.where(here, (basis * d_green)[:, None], 0.0)
                sh_blue += tl.where(here, (basis * d_blue)[:, None], 0.0)
        radial = to_x * d_to_x + to_y * d_to_y + to_z * d_to_z
        mean_x += tl.where(drawn, d_x + (d_to_x - to_x * radial) / distance, 0.0)
        mean_y += tl.where(drawn, d_y + (d_to_y - to_y * radial) / distance, 0.0)
        mean_z += tl.where(drawn, d_z + (d_to_z - to_z * radial) / distance, 0.0)
        camera += _CAMERA
        place += count

    tl.store(d_means + splat * 3, mean_x, mask=inside)
    tl.store(d_means + splat * 3 + 1, mean_y, mask=inside)
    tl.store(d_means + splat * 3 + 2, mean_z, mask=inside)
    tl.store(d_quats + splat * 4, quat_w, mask=inside)
    tl.store(d_quats + splat * 4 + 1, quat_x, mask=inside)
    tl.store(d_quats + splat * 4 + 2, quat_y, mask=inside)
    tl.store(d_quats + splat * 4 + 3, quat_z, mask=inside)
    tl.store(d_log_scales + splat * 3, log_x, mask=inside)
    tl.store(d_log_scales + splat * 3 + 1, log_y, mask=inside)
    tl.store(d_log_scales + splat * 3 + 2, log_z, mask=inside)
    # the opacity of splats that were never drawn may be NaN
    d_logit = tl.where(d_opacity == 0.0, 0.0, d_opacity * opacity * (1.0 - opacity))
    tl.store(d_logits + splat, d_logit, mask=inside)
    tl.store(d_offsets + splat * 2, offset_x, mask=inside)
    tl.store(d_offsets + splat * 2 + 1, offset_y, mask=inside)
    if COLORS:
        real = inside[:, None] & (coefficient < COEFFICIENTS)[None, :]
        into = d_sh + (splat[:, None] * COEFFICIENTS + coefficient[None, :]) * 3
        tl.store(into, sh_red, mask=real)
        tl.store(into + 1, sh_green, mask=real)
        tl.store(into + 2, sh_blue, mask=real)
