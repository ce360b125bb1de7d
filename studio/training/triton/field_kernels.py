"""The kernels of the motion field on an NVIDIA GPU (`field.py`): hash grid and MLP, forward and backward.

Each layer is a kernel of its own: a program holds 64x64 products in its registers, whatever the size of the MLP. One
kernel for all layers would keep whole weight matrices there, and from 64 neurons on, ptxas moves them to memory.

Sizes: N positions; L levels of F features; E = L * F, the length of an encoding; W neurons in each of H hidden layers.
Three matrices connect the kernels, each with a row for each position:

    inputs (N, E + H W)     what each layer reads: the encoding, then the outputs of the hidden layers
    slopes (N, H W + 3)     derivatives of the loss with respect to what each layer gives before its ReLU
    d_encoding (N, E)       derivatives with respect to the encoding

`parameters` holds the layers one after the other: a layer's weights (outputs, inputs), row by row, then its biases.

No kernel uses atomic operations, so that the same input gives the same bits. The gradient of the parameters has a row
for each chunk of positions. That of the table is summed in pieces, whose bounds `Corners.passes` of `hashgrid.py`
computes once for all steps of a frame.

With TRITON_INTERPRET=1, set before Triton is imported, the same code runs on the CPU.
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
from __future__ import annotations

import triton
import triton.language as tl

CHUNK = 512  # positions whose share of a parameter's gradient is one number
TILE = 64  # outputs and inputs of a layer for which a program of `parameter_gradient` computes
TILE_NUMBERS = 7  # numbers that describe such a tile
POSITIONS = 64  # positions of a program of `layer_forward` and `layer_backward`
SHORT = 32  # positions, and columns of their encodings, of a program of `encode`
PIECES = 16  # sums that a program of `sum_pieces` computes
_CHUNK = tl.constexpr(CHUNK)
_TILE = tl.constexpr(TILE)
_TILE_NUMBERS = tl.constexpr(TILE_NUMBERS)
_POSITIONS = tl.constexpr(POSITIONS)
_SHORT = tl.constexpr(SHORT)
_PIECES = tl.constexpr(PIECES)
_DEEP = tl.constexpr(16)  # numbers that tl.dot sums at once: it takes no fewer, and more do not fit into registers
_STEP = tl.constexpr(16)  # entries of a piece that are read at once


@triton.jit
def encode(table, rows, weights, inputs, count, length, features, columns):
    """The encodings: the table's rows at the eight corners, weighted.

    Args:
        table: (rows, F) float32.
        rows, weights: (L, N, 8) int32 and float32, see `Corners`.
        inputs: (N, columns) float32; its first E columns are the output.
        count, length, features: N, E and F.
    """
    position = tl.program_id(0) * _SHORT + tl.arange(0, _SHORT)
    column = tl.program_id(1) * _SHORT + tl.arange(0, _SHORT)
    mask = (position < count)[:, None] & (column < length)[None, :]
    position = position.to(tl.int64)[:, None]
    corner = ((column // features).to(tl.int64) * count)[None, :] + position
    feature = (column % features)[None, :]
    found = tl.zeros([_SHORT, _SHORT], tl.float32)
    for number in tl.static_range(8):
        row = tl.load(rows + corner * 8 + number, mask=mask, other=0).to(tl.int64)
        weight = tl.load(weights + corner * 8 + number, mask=mask, other=0.0)
        found += weight * tl.load(table + row * features + feature, mask=mask, other=0.0)
    tl.store(inputs + position * columns + column[None, :], found, mask=mask)


@triton.jit
def layer_forward(
    inputs, layer, side, out, count, reads, gives, input_columns, out_columns,
    OUTPUTS: tl.constexpr, LAST: tl.constexpr,
):  # fmt: skip
    """What a layer gives at some positions, for some of its outputs.

    Args:
        inputs: first number of what the layer reads, in rows of `input_columns` float32.
        layer: its weights, then its biases, float32.
        side: (1,) float32, factor of the outputs of the last layer.
        out: first number of what it gives, in rows of `out_columns` float32, output.
        count, reads, gives: positions, inputs and outputs of the layer.
        OUTPUTS: outputs of a program: a power of two of at least 16.
        LAST: it is the last layer: without ReLU, and times `side`.
    """
    position = tl.program_id(0) * _POSITIONS + tl.arange(0, _POSITIONS)
    inside = position < count
    position = position.to(tl.int64)
    output = tl.program_id(1) * OUTPUTS + tl.arange(0, OUTPUTS)
    given = output < gives
    sums = tl.zeros([_POSITIONS, OUTPUTS], tl.float32)
    for first in range(0, reads, _DEEP):
        number = first + tl.arange(0, _DEEP)
        there = number < reads
        value = tl.load(
            inputs + position[:, None] * input_columns + number[None, :],
            mask=inside[:, None] & there[None, :],
            other=0.0,
        )
        weight = tl.load(
            layer + output[None, :] * reads + number[:, None], mask=there[:, None] & given[None, :], other=0.0
        )
        sums = tl.dot(value, weight, sums, input_precision="ieee")
    sums += tl.load(layer + gives * reads + output, mask=given, other=0.0)[None, :]
    if LAST:
        sums *= tl.load(side)
    else:
        sums = tl.where(sums < 0.0, 0.0, sums)  # not tl.maximum, which would hide a NaN
    tl.store(out + position[:, None] * out_columns + output[None, :], sums, mask=inside[:, None] & given[None, :])


@triton.jit
def layer_backward(
    slopes, layer, read, out, count, reads, gives, slope_columns, input_columns, out_columns,
    INPUTS: tl.constexpr, FIRST: tl.constexpr,
):  # fmt: skip
    """The derivatives by what a layer reads at some positions, for some of its inputs; before the ReLU that gave them.

    Args:
        slopes: first derivative by what the layer gives, in rows of `slope_columns` float32.
        layer, count, reads, gives: as in `layer_forward`.
        read: first number of what the layer read, in rows of `input_columns` float32.
        out: first derivative by it, in rows of `out_columns` float32, output.
        INPUTS: inputs of a program: a power of two of at least 16.
        FIRST: it is the first layer: it reads the encoding, which no ReLU gave.
    """
    position = tl.program_id(0) * _POSITIONS + tl.arange(0, _POSITIONS)
    inside = position < count
    position = position.to(tl.int64)
    number = tl.program_id(1) * INPUTS + tl.arange(0, INPUTS)
    there = number < reads
    sums = tl.zeros([_POSITIONS, INPUTS], tl.float32)
    for first in range(0, gives, _DEEP):
        output = first + tl.arange(0, _DEEP)
        given = output < gives
        slope = tl.load(
            slopes + position[:, None] * slope_columns + output[None, :],
            mask=inside[:, None] & given[None, :],
            other=0.0,
        )
        weight = tl.load(
            layer + output[:, None] * reads + number[None, :], mask=given[:, None] & there[None, :], other=0.0
        )
        sums = tl.dot(slope, weight, sums, input_precision="ieee")
    shown = inside[:, None] & there[None, :]
    if not FIRST:
        value = tl.load(read + position[:, None] * input_columns + number[None, :], mask=shown, other=0.0)
        sums = tl.where(value <= 0.0, 0.0, sums)
    tl.store(out + position[:, None] * out_columns + number[None, :], sums, mask=shown)


@triton.jit
def parameter_gradient(inputs, slopes, tiles, shares, count, input_columns, slope_columns, total):
    """A chunk's share of the gradient of a tile of a layer's weights, and of its biases.

    Args:
        inputs, slopes: (N, input_columns) and (N, slope_columns) float32, see above.
        tiles: (tiles, 7) int32: first column of `slopes` and how many, first column of `inputs` and how many, the
            tile's first weight among the parameters, weights from one output to the next, and the first bias; -1: the
            tile has none.
        shares: (chunks, total) float32, output.
        count, total: N, and numbers in `parameters`.
    """
    tile = tiles + tl.program_id(1) * _TILE_NUMBERS
    slope_column = tl.load(tile)
    slope_count = tl.load(tile + 1)
    input_column = tl.load(tile + 2)
    input_count = tl.load(tile + 3)
    weight = tl.load(tile + 4)
    stride = tl.load(tile + 5)
    bias = tl.load(tile + 6)
    number = tl.arange(0, _TILE)
    gives = number < slope_count
    reads = number < input_count
    sums = tl.zeros([_TILE, _TILE], tl.float32)
    bias_sums = tl.zeros([_TILE], tl.float32)
    start = tl.program_id(0) * _CHUNK
    for first in range(start, tl.minimum(start + _CHUNK, count), _DEEP):
        position = first + tl.arange(0, _DEEP)
        inside = position < count
        position = position.to(tl.int64)
        slope = tl.load(
            slopes + position[None, :] * slope_columns + slope_column + number[:, None],
            mask=gives[:, None] & inside[None, :],
            other=0.0,
        )
        value = tl.load(
            inputs + position[:, None] * input_columns + input_column + number[None, :],
            mask=inside[:, None] & reads[None, :],
            other=0.0,
        )
        sums = tl.dot(slope, value, sums, input_precision="ieee")
        bias_sums += tl.sum(slope, axis=1)
    share = shares + tl.program_id(0).to(tl.int64) * total
    tl.store(share + weight + number[:, None] * stride + number[None, :], sums, mask=gives[:, None] & reads[None, :])
    tl.store(share + bias + number, bias_sums, mask=gives & (bias >= 0))


@triton.jit
def sum_pieces(
    values, readers, weights, begins, ends, sums, pieces, features,
    FEATURES: tl.constexpr, FIRST: tl.constexpr,
):  # fmt: skip
    """Sums over pieces: in the first pass, of what reads one row of the table; then of adjacent rows of such sums.

    Args:
        values: (V, F) float32: in the first pass `d_encoding`, then the sums of the pass before.
        readers, weights: (8 N L,) int32 and float32: row of `values`, and its weight, ordered by row of the table; only
            read in the first pass.
        begins, ends: (pieces,) int64, bounds of each piece in `readers`, later in `values`.
        sums: (pieces, F) float32, output.
        pieces, features: number of pieces, and F.
        FEATURES: F, padded to a power of two.
        FIRST: it is the first pass.
    """
    piece = tl.program_id(0) * _PIECES + tl.arange(0, _PIECES)
    there = piece < pieces
    begin = tl.load(begins + piece, mask=there, other=0)
    end = tl.load(ends + piece, mask=there, other=0)
    feature = tl.arange(0, FEATURES)
    real = feature < features
    total = tl.zeros([_PIECES, FEATURES], tl.float32)
    for first in tl.range(0, tl.max(end - begin, axis=0), _STEP, num_stages=1):
        entry = begin[:, None] + first + tl.arange(0, _STEP)[None, :]
        mask = entry < end[:, None]
        row = entry
        if FIRST:
            row = tl.load(readers + entry, mask=mask, other=0).to(tl.int64)
        value = tl.load(
            values + row[:, :, None] * features + feature[None, None, :],
            mask=mask[:, :, None] & real[None, None, :],
            other=0.0,
        )
        if FIRST:
            value *= tl.load(weights + entry, mask=mask, other=0.0)[:, :, None]
        total += tl.sum(value, axis=1)
    place = sums + piece.to(tl.int64)[:, None] * features + feature[None, :]
    tl.store(place, total, mask=there[:, None] & real[None, :])
