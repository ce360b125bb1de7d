"""The motion field between two frames: a hash grid and a shallow MLP (paper section 4.1, equations 5 and 6)."""

from typing import Any

import torch
from torch import Tensor, nn

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.cpu import kernel_threads
from v3studio.studio.rasterizer.kernels import kernels_for
from v3studio.studio.rasterizer.types import ALPHA_MIN
from v3studio.studio.training.adam import Adam, ParameterGroup
from v3studio.studio.training.hashgrid import Corners, HashGrid

_BOX_PADDING = 0.05  # padding of the bounding box, as a fraction of its longest side
_NEIGHBORS = 24  # neighbors over which velocities are smoothed (docs/measurements/training.md)


def predicted_means(
    previous: Gaussians, before_previous: Gaussians | None, third_last: Gaussians | None, acceleration: float
) -> Tensor:
    """(N, 3) means of frame t, extrapolated from earlier frames.

    Args:
        previous: splats of frame t-1.
        before_previous: splats of frame t-2; None: the means of frame t-1 are returned.
        third_last: splats of frame t-3; None: constant velocity.
        acceleration: fraction of the last change in velocity that is added to the velocity.
    """
    if before_previous is None:
        return previous.means
    velocity = previous.means - before_previous.means
    if acceleration and third_last is not None:
        velocity = velocity + acceleration * (velocity - (before_previous.means - third_last.means))
    # At motion boundaries, such as a limb in front of the body, a median follows one side; a mean would blend both.
    near = neighbors(previous.means, _NEIGHBORS)
    velocity = torch.cat([velocity[:, None], velocity[near]], dim=1).median(dim=1).values
    # Splats that are too faint to be rendered have no gradients, so nothing would ever stop them.
    visible = previous.opacities.reshape(-1, 1) >= ALPHA_MIN
    return previous.means + torch.where(visible, velocity, torch.zeros_like(velocity))


def neighbors(means: Tensor, count: int) -> Tensor:
    """(N, k) int64 indices of the k = min(count, N - 1) nearest other splats, from (N, 3) means."""
    from scipy.spatial import cKDTree

    array = means.detach().cpu().numpy()
    nearest = cKDTree(array).query(array, k=min(count + 1, len(array)), workers=-1)[1]
    return torch.from_numpy(nearest.reshape(len(array), -1)[:, 1:]).to(means.device)


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
        d_weights, d_biases = [[torch.empty_like(layer) for layer in layers] for layers in (weights, biases)]
        ctx.kernels.field_backward(
            ctx.field_pass, *ctx.inputs, *ctx.network, upstream[0].contiguous(), d_table, d_weights, d_biases,
            kernel_threads(),
        )  # fmt: skip
        layers = [gradient for pair in zip(d_weights, d_biases, strict=True) for gradient in pair]
        return None, None, None, d_table, *layers


class MotionField(nn.Module):
    """Translation of each splat from frame t-1 to frame t: x_t = x_{t-1} + MLP(h(x_{t-1})).

    Positions are normalized by the performer's bounding box, and the output is in units of its longest side, so the
    field does not depend on the scale of the scene. The last layer is initialized to zero, so the initial motion is
    zero.

    Args:
        low, high: (3,) corners of the performer's bounding box, world units.
        width: neurons per hidden layer of the MLP.
        generator: draws the initial weights; equal seeds give equal fields.
    """

    _low: Tensor
    side: Tensor

    def __init__(
        self, low: Tensor, high: Tensor, grid: HashGrid, width: int, layers: int, generator: torch.Generator
    ) -> None:
        super().__init__()
        side = (high - low).amax().clamp_min(1e-9)
        self.register_buffer("_low", (low + high) / 2 - side * (0.5 + _BOX_PADDING))
        self.register_buffer("side", side * (1 + 2 * _BOX_PADDING))
        self.grid = grid
        hidden: list[nn.Module] = []
        for inputs in (grid.width, *[width] * (layers - 1)):
            hidden += [nn.Linear(inputs, width), nn.ReLU()]
        last = nn.Linear(width, 3)
        self.mlp = nn.Sequential(*hidden, last)
        with torch.no_grad():
            for layer in self.mlp:
                if isinstance(layer, nn.Linear):
                    bound = layer.in_features**-0.5
                    layer.weight.uniform_(-bound, bound, generator=generator)
                    layer.bias.zero_()
            last.weight.zero_()

    def corners(self, means: Tensor) -> Corners:
        """Input of `forward` for fixed (N, 3) world positions; compute it once per frame."""
        return self.grid.corners((means - self._low) / self.side)

    def forward(self, corners: Corners) -> Tensor:
        """(N, 3) translations in world units, by one kernel on the CPU."""
        table, parameters = self.grid.table, list(self.mlp.parameters())
        kernels = kernels_for(table, corners.weights)
        if kernels is not None:
            return _Fused.apply(kernels, corners, float(self.side), table, *parameters)  # type: ignore[no-untyped-call,no-any-return]
        return self.forward_torch(corners)

    def forward_torch(self, corners: Corners) -> Tensor:
        """`forward` in plain PyTorch, for any device and dtype. This is the definition of the field."""
        return self.mlp(self.grid(corners)) * self.side

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
