"""The motion field on an NVIDIA GPU: kernels of Triton for hash grid and MLP, forward and backward, and no wait.

Any size of the grid and of the MLP is possible. Sums are float32 without TF32. Triton compiles the kernels when they
are first used. It is imported only then.
"""

from __future__ import annotations

import functools
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from studio.training.hashgrid import Corners

WARPS = 4  # warps of a program
_LEAST, _MOST = 16, 64  # columns of a program: tl.dot takes no fewer, and more do not fit into its registers


@dataclass(frozen=True)
class _Layer:
    """A layer of the MLP, and its place in the matrices of `field_kernels.py`.

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
        kernels = importlib.import_module("studio.training.triton.field_kernels")
        sizes = tuple((int(weight.shape[0]), int(weight.shape[1])) for weight in parameters[::2])
        layers = _layers(sizes)
        flat = torch.cat([one.detach().reshape(-1) for one in parameters])
        table, count, length = table.detach().contiguous(), corners.positions, layers[0].reads
        inputs = table.new_empty((count, layers[-1].inputs + layers[-1].reads))
        out = table.new_empty((count, 3))
        columns = inputs.shape[1]
        with torch.cuda.device_of(table):
            if count:
                kernels.encode[(math.ceil(count / kernels.SHORT), math.ceil(length / kernels.SHORT))](
                    table, corners.rows, corners.weights, inputs, count, length, table.shape[1], columns,
                    num_warps=WARPS,
                )  # fmt: skip
            for number, layer in enumerate(layers if count else ()):
                last = number + 1 == len(layers)
                outputs = _columns(layer.gives)
                kernels.layer_forward[(math.ceil(count / kernels.POSITIONS), math.ceil(layer.gives / outputs))](
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
        kernels = importlib.import_module("studio.training.triton.field_kernels")
        side, flat, inputs = ctx.saved_tensors
        layers, count = _layers(ctx.sizes), len(inputs)
        if count:
            width = layers[-1].slopes + 3
            slopes, d_encoding = inputs.new_empty((count, width)), inputs.new_empty((count, layers[0].reads))
            torch.mul(upstream[0], side, out=slopes[:, layers[-1].slopes :])
            shares = inputs.new_empty((math.ceil(count / kernels.CHUNK), len(flat)))
            d_table = inputs.new_empty(ctx.table)
            tiles = _tiles(ctx.sizes, kernels.TILE, inputs.device)
            with torch.cuda.device_of(inputs):
                _slopes(kernels, layers, flat, inputs, slopes, d_encoding)
                kernels.parameter_gradient[(len(shares), len(tiles))](
                    inputs, slopes, tiles, shares, count, inputs.shape[1], width, len(flat), num_warps=WARPS
                )
                _spread(kernels, ctx.corners, d_encoding, d_table)
            d_flat = shares.sum(0)
        else:
            d_table, d_flat = inputs.new_zeros(ctx.table), torch.zeros_like(flat)
        parts = d_flat.split([part for layer in layers for part in (layer.gives * layer.reads, layer.gives)])
        shapes = [shape for size in ctx.sizes for shape in (size, size[:1])]
        return None, None, d_table, *(part.view(shape) for part, shape in zip(parts, shapes, strict=True))


def _slopes(
    kernels: Any, layers: Sequence[_Layer], flat: Tensor, inputs: Tensor, slopes: Tensor, d_encoding: Tensor
) -> None:
    """From the slopes of the last layer to those of the others and to the gradient of the encodings."""
    for number in reversed(range(len(layers))):
        layer = layers[number]
        out = slopes[:, layers[number - 1].slopes :] if number else d_encoding
        columns = _columns(layer.reads)
        kernels.layer_backward[(math.ceil(len(inputs) / kernels.POSITIONS), math.ceil(layer.reads / columns))](
            slopes[:, layer.slopes :], flat[layer.first :], inputs[:, layer.inputs :], out, len(inputs), layer.reads,
            layer.gives, slopes.shape[1], inputs.shape[1], out.stride(0), INPUTS=columns, FIRST=number == 0,
            num_warps=WARPS,
        )  # fmt: skip


def _spread(kernels: Any, corners: Corners, d_encoding: Tensor, d_table: Tensor) -> None:
    """The gradient of the table, in as many passes as the row needs that is read most."""
    features = d_table.shape[1]
    passes = corners.passes
    values = d_encoding
    for number, (begins, ends) in enumerate(passes.pieces):
        last = number + 1 == len(passes.pieces)
        sums = d_table if last else values.new_empty((len(begins), features))
        kernels.sum_pieces[(math.ceil(len(begins) / kernels.PIECES),)](
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
