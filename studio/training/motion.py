"""The motion field between two frames: a hash grid and a shallow MLP (paper section 4.1, equations 5 and 6)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from studio.errors import StudioError
from studio.rasterizer import available_backends
from studio.rasterizer.cpu import kernel_threads
from studio.rasterizer.kernels import kernels_for
from studio.training.adam import Adam, ParameterGroup
from studio.training.hashgrid import Corners, HashGrid
from studio.training.settings import TrainSettings
from studio.training.triton_field import motion_field_triton

_BOX_PADDING = 0.05
"""Padding of the bounding box, as a fraction of its longest side."""


class _Fused(torch.autograd.Function):
    """(N, 3) outputs of the network times `scale`, and the gradients of the table, the weights and the biases."""

    @staticmethod
    def forward(ctx: Any, kernels: Any, corners: Corners, scale: float, table: Tensor, *layers: Tensor) -> Tensor:
        parameters = [table.detach().contiguous(), *(layer.detach().contiguous() for layer in layers)]
        ctx.inputs = (corners.rows, corners.weights, corners.level_rows)
        ctx.network = (parameters[0], parameters[1::2], parameters[2::2], scale)
        ctx.kernels = kernels
        out = table.new_empty((corners.positions, 3))
        ctx.field_pass = kernels.field_forward(*ctx.inputs, *ctx.network, out, kernel_threads())
        return out

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        table, weights, biases, _ = ctx.network
        d_table = torch.empty_like(table)
        d_weights, d_biases = [torch.empty_like(one) for one in weights], [torch.empty_like(one) for one in biases]
        ctx.kernels.field_backward(
            ctx.field_pass,
            *ctx.inputs,
            *ctx.network,
            upstream[0].contiguous(),
            d_table,
            d_weights,
            d_biases,
            kernel_threads(),
        )
        layers = [gradient for pair in zip(d_weights, d_biases, strict=True) for gradient in pair]
        return None, None, None, d_table, *layers


class MotionField(nn.Module):
    """Translation of each splat from frame t-1 to frame t: x_t = x_{t-1} + MLP(h(x_{t-1})).

    Positions are normalized by the performer's bounding box, and the output is in units of its longest side, so the
    field does not depend on the scale of the scene. The last layer is initialized to zero, so the initial motion is
    zero.

    Args:
        low, high: (3,) corners of the performer's bounding box, world units.
        settings: sizes of the grid and the MLP.
        generator: draws the initial weights; equal seeds give equal fields.
    """

    _low: Tensor
    _side: Tensor

    def __init__(self, low: Tensor, high: Tensor, settings: TrainSettings, generator: torch.Generator) -> None:
        super().__init__()
        side = (high - low).amax().clamp_min(1e-9)
        self.register_buffer("_low", (low + high) / 2 - side * (0.5 + _BOX_PADDING))
        self.register_buffer("_side", side * (1 + 2 * _BOX_PADDING))
        self.grid = HashGrid(
            settings.hash_levels,
            settings.hash_features,
            settings.hash_log2_size,
            settings.hash_base_resolution,
            settings.hash_growth,
            generator,
        )
        layers: list[nn.Module] = []
        width = self.grid.width
        for _ in range(settings.mlp_layers):
            layers += [nn.Linear(width, settings.mlp_width), nn.ReLU()]
            width = settings.mlp_width
        last = nn.Linear(width, 3)
        self.mlp = nn.Sequential(*layers, last)
        with torch.no_grad():
            for layer in self.mlp:
                if isinstance(layer, nn.Linear):
                    bound = layer.in_features**-0.5
                    layer.weight.uniform_(-bound, bound, generator=generator)
                    layer.bias.zero_()
            last.weight.zero_()

    def corners(self, means: Tensor) -> Corners:
        """Input of `forward` for fixed (N, 3) world positions; compute it once per frame."""
        return self.grid.corners((means - self._low) / self._side)

    def forward(self, corners: Corners) -> Tensor:
        """(N, 3) translations in world units. One kernel on the CPU, and several on an NVIDIA GPU with Triton, evaluate
        grid and MLP, whatever their sizes."""
        table, parameters = self.grid.table, list(self.mlp.parameters())
        kernels = kernels_for(table, corners.weights)
        if kernels is not None:
            return _Fused.apply(kernels, corners, float(self._side), table, *parameters)  # type: ignore[no-untyped-call,no-any-return]
        if table.device.type == "cuda" and table.dtype == torch.float32 and "triton" in available_backends():
            return motion_field_triton(corners, self._side, table, parameters)
        return self.forward_torch(corners)

    def forward_torch(self, corners: Corners) -> Tensor:
        """`forward` in plain PyTorch, for any device and dtype. This is the definition of the field."""
        return self.mlp(self.grid(corners)) * self._side

    def weights(self) -> dict[str, Tensor]:
        """Copies of the trained parameters by name, without the bounding box."""
        return {name: value.detach().clone() for name, value in self.named_parameters()}

    def load_weights(self, weights: dict[str, Tensor]) -> None:
        """Load the `weights` of a field with the same sizes; its bounding box may differ.

        Raises:
            StudioError: `training.motion_network_size`: the sizes differ.
        """
        own = dict(self.named_parameters())
        if {name: value.shape for name, value in weights.items()} != {name: value.shape for name, value in own.items()}:
            raise StudioError(
                "training.motion_network_size",
                "the motion network of the previous frame has different sizes",
                fix="Train the group again",
            )
        with torch.no_grad():
            for name, value in weights.items():
                own[name].copy_(value)

    def optimizer(self, learning_rate: float) -> Adam:
        """Adam with the settings of Mueller et al. for hash grids; the table learns at ten times `learning_rate`."""
        return Adam(
            [
                ParameterGroup([self.grid.table], 10 * learning_rate),
                ParameterGroup(list(self.mlp.parameters()), learning_rate),
            ],
            betas=(0.9, 0.99),
            eps=1e-15,
        )
