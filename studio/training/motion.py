"""The motion field of one frame step: hash grid and shallow MLP (paper section 4.1, equations 5 and 6)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from studio.errors import StudioError
from studio.training.hashgrid import Corners, HashGrid
from studio.training.settings import TrainSettings

_BOX_PADDING = 0.05
"""Share of the box by which positions are kept off its border."""


class MotionField(nn.Module):
    """Translation of each splat from frame t-1 to frame t: x_t = x_{t-1} + MLP(h(x_{t-1})).

    Positions are normalized by the performer's bounding box, so neither the grid nor the network sees the scale of
    the world; the network's output is in units of the box's longest side. The last layer starts at zero: before
    training nothing moves.

    Args:
        low, high: (3,) corners of the performer's box, world units.
        settings: sizes of grid and network.
        generator: draws the first weights; the same seed gives the same field.
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
        """What `forward` needs of fixed (N, 3) world positions; compute it once a frame."""
        return self.grid.corners((means - self._low) / self._side)

    def forward(self, corners: Corners) -> Tensor:
        """(N, 3) translations, world units."""
        return self.mlp(self.grid(corners)) * self._side

    def weights(self) -> dict[str, Tensor]:
        """Copies of what was learned, by name; the box is not among them."""
        return {name: value.detach().clone() for name, value in self.named_parameters()}

    def load_weights(self, weights: dict[str, Tensor]) -> None:
        """Go on from the `weights` of a field of the same sizes, over whatever box.

        Raises:
            StudioError: they are of another size.
        """
        own = dict(self.named_parameters())
        if {name: value.shape for name, value in weights.items()} != {name: value.shape for name, value in own.items()}:
            raise StudioError("The motion network of the frame before has another size; train the group anew.")
        with torch.no_grad():
            for name, value in weights.items():
                own[name].copy_(value)

    def optimizer(self, learning_rate: float) -> torch.optim.Adam:
        """Adam with the settings that Mueller et al. use for hash grids; the table learns ten times as fast."""
        return torch.optim.Adam(
            [
                {"params": [self.grid.table], "lr": 10 * learning_rate},
                {"params": self.mlp.parameters(), "lr": learning_rate},
            ],
            betas=(0.9, 0.99),
            eps=1e-15,
            fused=True,
        )
