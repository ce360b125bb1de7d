"""The motion field on an NVIDIA GPU: kernels of Triton for hash grid and MLP, forward and backward, and no wait.

Any size of the grid and of the MLP is possible. Sums are float32 without TF32.

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
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
import triton
import triton.language as tl
from torch import Tensor
from torch.autograd.function import once_differentiable

from v3studio.studio.training.hashgrid import Corners

WARPS = 4  # warps of a program
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
_LEAST, _MOST = 16, 64  # columns of a program: tl.dot takes no fewer, and more do not fit into its registers
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
    """Compute some outputs of a layer at some positions.

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
    """Compute the derivatives by some of a layer's inputs at some positions, before the ReLU that gave them.

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
    """Sum the numbers of each piece: in the first pass the gradients of one row of the table, then adjacent sums.

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


@dataclass(frozen=True)
class _Layer:
    """A layer of the MLP, and its place in the matrices.

    Attributes:
        first: its first number among the parameters.
        inputs: column of `inputs` of the first one that it reads.
        slopes: column of `slopes` of the first one that it gives.
    """

    reads: int
    gives: int
    first: int
    inputs: int
    slopes: int


@functools.cache
def _layers(sizes: tuple[tuple[int, int], ...]) -> list[_Layer]:
    layers, first, inputs, slopes = [], 0, 0, 0
    for gives, reads in sizes:
        layers.append(_Layer(reads, gives, first, inputs, slopes))
        first, inputs, slopes = first + (reads + 1) * gives, inputs + reads, slopes + gives
    return layers


@functools.cache
def _tiles(sizes: tuple[tuple[int, int], ...], size: int, device: torch.device) -> Tensor:
    """(tiles, 7) int32 tiles of all layers, see `parameter_gradient`."""
    tiles = [
        (
            layer.slopes + down,
            min(size, layer.gives - down),
            layer.inputs + right,
            min(size, layer.reads - right),
            layer.first + down * layer.reads + right,
            layer.reads,
            -1 if right else layer.first + layer.gives * layer.reads + down,
        )
        for layer in _layers(sizes)
        for down in range(0, layer.gives, size)
        for right in range(0, layer.reads, size)
    ]
    return torch.tensor(tiles, dtype=torch.int32, device=device)


def _columns(count: int) -> int:
    return min(max(1 << (count - 1).bit_length(), _LEAST), _MOST)


class _Fused(torch.autograd.Function):
    """The outputs, and the gradients of the table, the weights and the biases."""

    @staticmethod
    def forward(ctx: Any, corners: Corners, side: Tensor, table: Tensor, *parameters: Tensor) -> Tensor:
        sizes = tuple((int(weight.shape[0]), int(weight.shape[1])) for weight in parameters[::2])
        layers = _layers(sizes)
        flat = torch.cat([parameter.detach().reshape(-1) for parameter in parameters])
        table, count, length = table.detach().contiguous(), corners.positions, layers[0].reads
        inputs = table.new_empty((count, layers[-1].inputs + layers[-1].reads))
        out = table.new_empty((count, 3))
        columns = inputs.shape[1]
        with torch.cuda.device_of(table):
            if count:
                encode[(math.ceil(count / SHORT), math.ceil(length / SHORT))](
                    table, corners.rows, corners.weights, inputs, count, length, table.shape[1], columns,
                    num_warps=WARPS,
                )  # fmt: skip
            for number, layer in enumerate(layers if count else ()):
                last = number + 1 == len(layers)
                outputs = _columns(layer.gives)
                layer_forward[(math.ceil(count / POSITIONS), math.ceil(layer.gives / outputs))](
                    inputs[:, layer.inputs :], flat[layer.first :], side,
                    out if last else inputs[:, layers[number + 1].inputs :], count, layer.reads, layer.gives, columns,
                    3 if last else columns, OUTPUTS=outputs, LAST=last, num_warps=WARPS,
                )  # fmt: skip
        ctx.corners, ctx.sizes, ctx.table = corners, sizes, table.shape
        ctx.save_for_backward(side, flat, inputs)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        side, flat, inputs = ctx.saved_tensors
        layers, count = _layers(ctx.sizes), len(inputs)
        if count:
            width = layers[-1].slopes + 3
            slopes, d_encoding = inputs.new_empty((count, width)), inputs.new_empty((count, layers[0].reads))
            torch.mul(upstream[0], side, out=slopes[:, layers[-1].slopes :])
            shares = inputs.new_empty((math.ceil(count / CHUNK), len(flat)))
            d_table = inputs.new_empty(ctx.table)
            tiles = _tiles(ctx.sizes, TILE, inputs.device)
            with torch.cuda.device_of(inputs):
                _slopes(layers, flat, inputs, slopes, d_encoding)
                parameter_gradient[(len(shares), len(tiles))](
                    inputs, slopes, tiles, shares, count, inputs.shape[1], width, len(flat), num_warps=WARPS
                )
                _spread(ctx.corners, d_encoding, d_table)
            d_flat = shares.sum(0)
        else:
            d_table, d_flat = inputs.new_zeros(ctx.table), torch.zeros_like(flat)
        parts = d_flat.split([part for layer in layers for part in (layer.gives * layer.reads, layer.gives)])
        shapes = [shape for size in ctx.sizes for shape in (size, size[:1])]
        return None, None, d_table, *(part.view(shape) for part, shape in zip(parts, shapes, strict=True))


def _slopes(layers: Sequence[_Layer], flat: Tensor, inputs: Tensor, slopes: Tensor, d_encoding: Tensor) -> None:
    """Compute the slopes of the other layers and the gradient of the encodings from the slopes of the last layer."""
    for number in reversed(range(len(layers))):
        layer = layers[number]
        out = slopes[:, layers[number - 1].slopes :] if number else d_encoding
        columns = _columns(layer.reads)
        layer_backward[(math.ceil(len(inputs) / POSITIONS), math.ceil(layer.reads / columns))](
            slopes[:, layer.slopes :], flat[layer.first :], inputs[:, layer.inputs :], out, len(inputs), layer.reads,
            layer.gives, slopes.shape[1], inputs.shape[1], out.stride(0), INPUTS=columns, FIRST=number == 0,
            num_warps=WARPS,
        )  # fmt: skip


def _spread(corners: Corners, d_encoding: Tensor, d_table: Tensor) -> None:
    """The gradient of the table, in as many passes as the row needs that is read most."""
    features = d_table.shape[1]
    passes = corners.passes
    values = d_encoding
    for number, (begins, ends) in enumerate(passes.pieces):
        last = number + 1 == len(passes.pieces)
        sums = d_table if last else values.new_empty((len(begins), features))
        sum_pieces[(math.ceil(len(begins) / PIECES),)](
            values, passes.readers, passes.weights, begins, ends, sums, len(begins), features,
            FEATURES=1 << (features - 1).bit_length(), FIRST=number == 0, num_warps=WARPS,
        )  # fmt: skip
        values = sums


def motion_field_triton(corners: Corners, side: Tensor, table: Tensor, parameters: Sequence[Tensor]) -> Tensor:
    """`MotionField.forward` for float32 on an NVIDIA GPU; with Triton's interpreter, on the CPU.

    Args:
        corners: of N positions.
        side: scalar, factor of the outputs.
        table: (rows, F) of the hash grid.
        parameters: weights (outputs, inputs) and biases (outputs,) of each layer.

    Returns:
        (N, 3). The table and the parameters get gradients.
    """
    out: Tensor = _Fused.apply(corners, side, table, *parameters)
    return out
