"""Multiresolution hash encoding (paper equation 5; Mueller et al. 2022, section 3) in plain PyTorch, CPU and CUDA.

The encoded positions are fixed during the motion stage of a frame, so the table rows that each position reads and their
trilinear weights are computed once. On the CPU, `motion.py` evaluates grid and MLP with one kernel instead.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

_PRIMES = (1, 2_654_435_761, 805_459_861)


@dataclass(frozen=True)
class Corners:
    """Corners of the cell of each of N positions per level: rows (L, N, 8), trilinear weights, and (L + 1,) starts."""

    rows: Tensor
    weights: Tensor
    level_rows: Tensor

    @property
    def positions(self) -> int:
        """N, the number of positions."""
        return self.rows.shape[1]


class HashGrid(nn.Module):
    """A hash grid with L levels of F features, for positions in [0, 1]^3.

    Level l has floor(base_resolution * growth^l) cells per axis. A level that fits into 2^log2_size rows is stored as a
    dense grid; finer levels are hashed.

    Args:
        levels: number of levels, L.
        features: features per level, F.
        log2_size: base-2 logarithm of the number of rows of a hashed level.
        base_resolution: cells per axis at level 0.
        growth: resolution factor between levels.
        generator: draws the initial table, uniform in [-1e-4, 1e-4].
    """

    def __init__(
        self,
        levels: int = 16,
        features: int = 4,
        log2_size: int = 15,
        base_resolution: int = 16,
        growth: float = 1.5,
        generator: torch.Generator | None = None,
    ) -> None:
        super().__init__()
        self.resolutions = [int(base_resolution * growth**level) for level in range(levels)]
        capacity = 2**log2_size
        self.rows = [min((resolution + 1) ** 3, capacity) for resolution in self.resolutions]
        self.features = features
        table = torch.rand(sum(self.rows), features, generator=generator) * 2e-4 - 1e-4
        self.table = nn.Parameter(table)

    @property
    def width(self) -> int:
        """Length of an encoding: levels * features."""
        return len(self.rows) * self.features

    @torch.no_grad()
    def corners(self, positions: Tensor) -> Corners:
        """The corners for (N, 3) positions; coordinates are clamped to [0, 1]."""
        device = positions.device
        indices, weights = [], []
        first_row, starts = 0, [0]
        offsets = torch.tensor([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], device=device)
        for resolution, rows in zip(self.resolutions, self.rows, strict=True):
            scaled = positions.clamp(0, 1) * resolution
            cell = scaled.floor().clamp(max=resolution - 1)
            fraction = (scaled - cell)[:, None, :]
            corner = cell.long()[:, None, :] + offsets
            weights.append(torch.where(offsets.bool(), fraction, 1 - fraction).prod(-1))
            if (resolution + 1) ** 3 <= rows:
                index = (corner[..., 0] * (resolution + 1) + corner[..., 1]) * (resolution + 1) + corner[..., 2]
            else:
                mixed = corner[..., 0] * _PRIMES[0] ^ corner[..., 1] * _PRIMES[1] ^ corner[..., 2] * _PRIMES[2]
                index = mixed % rows
            indices.append((index + first_row).int())
            first_row += rows
            starts.append(first_row)
        return Corners(torch.stack(indices), torch.stack(weights).to(self.table.dtype), torch.tensor(starts))

    def forward(self, corners: Corners) -> Tensor:
        """(N, L * F) encodings of the positions of `corners`, level by level."""
        levels = (self.table[corners.rows] * corners.weights[..., None]).sum(2)
        return levels.transpose(0, 1).reshape(corners.positions, self.width)
