"""Segmentation into blocks of splats that move alike, each with one affine motion per frame.

Neighbors in space need not move together (an arm that swings past the hip), so runs of the Morton order would not do.
Instead, the splats are bisected recursively along the principal axis of positions, trajectories and residuals of an
affine fit, as long as the better prediction saves more bits than the additional motion costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_SAMPLES = 4  # frames that the cost of a split is measured on
_MIN_SPLATS = 32
_FORCED_DEPTH = 3  # the first splits are always made: a split may pay off only after further splits
_PARAMETER_BITS = 4.0  # bits per motion parameter, measured
_LABEL_BITS = 0.3  # additional bits per label when a block is split
_ITERATIONS = 4
_RIDGE = 0.05


def _residual(points: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(n, D) targets minus their least-squares affine fit from (n, 3) positions."""
    design = np.concatenate([points - points.mean(axis=0), np.ones((len(points), 1))], axis=1)
    normal = design.T @ design + 1e-9 * len(points) * np.eye(4)
    residual: np.ndarray = targets - design @ np.linalg.solve(normal, design.T @ targets)
    return residual


def _border(values: np.ndarray) -> int:
    """Index that splits sorted values with the largest between-class variance (Otsu 1979), at least an eighth on either
    side."""
    counts = np.arange(1, len(values))
    sums = np.cumsum(values)[:-1]
    between = (sums * len(values) / counts - values.sum()) ** 2 * counts / (len(values) - counts)
    margin = len(values) // 8
    return margin + int(between[margin - 1 : len(values) - margin].argmax())


def find_blocks(positions: np.ndarray, step: float) -> np.ndarray:
    """(N,) int64 labels of the blocks that splats (F, N, 3) move with, to within `step`; first splats ascend."""
    frames, splats = positions.shape[:2]
    labels = np.zeros(splats, dtype=np.int64)
    if frames == 1:
        return labels
    judged = np.unique(np.linspace(1, frames - 1, min(_SAMPLES, frames - 1)).round().astype(int))
    paths = positions[sorted({frames // 3, 2 * frames // 3, frames - 1})].transpose(1, 0, 2).reshape(splats, -1)
    # The video predicts a residual from the previous frame, so its change from frame to frame costs bits.
    steps = (positions[judged] - positions[judged - 1]).transpose(1, 0, 2).reshape(splats, -1)
    keyframe = positions[0]

    def bits(index: np.ndarray) -> float:
        squares = (_residual(keyframe[index], steps[index]) ** 2).reshape(len(index), -1, 3).mean(axis=2)
        return float(1.5 * np.log2(squares / step**2 + 1).sum() * (frames - 1) / len(judged))

    def halves(index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rest = _residual(keyframe[index], paths[index])
        features = np.concatenate([keyframe[index], paths[index], 3 * rest], axis=1)
        features -= features.mean(axis=0)
        along = features @ np.linalg.eigh(features.T @ features)[1][:, -1]
        order = np.argsort(along, kind="stable")
        middle = _border(along[order])
        return index[np.sort(order[:middle])], index[np.sort(order[middle:])]

    done: list[np.ndarray] = []
    waiting = [(np.arange(splats), bits(np.arange(splats)), 0)]
    while waiting:
        index, cost, depth = waiting.pop()
        if len(index) < 2 * _MIN_SPLATS:
            done.append(index)
            continue
        parts = halves(index)
        costs = [bits(part) for part in parts]
        price = 12 * (frames - 1) * _PARAMETER_BITS + _LABEL_BITS * len(index)
        gain = cost - sum(costs) - price
        if gain <= 0 and len(index) >= 8 * _MIN_SPLATS:  # a second split may pay off where the first alone does not
            quarters = [[bits(quarter) for quarter in halves(part)] for part in parts]
            gain = cost - price
            for whole, quarter in zip(costs, quarters, strict=True):
                gain -= min(whole, sum(quarter) + price / 2)
        if gain > 0 or (depth < _FORCED_DEPTH and cost > 0):
            waiting += [(part, c, depth + 1) for part, c in zip(parts, costs, strict=True)]
        else:
            done.append(index)
    done.sort(key=lambda index: int(index[0]))
    for label, index in enumerate(done):
        labels[index] = label
    return labels


@dataclass(frozen=True)
class Blocks:
    """Blocks over the keyframe's means; encoder and decoder run the same computation. `labels`, (N,): block of each
    splat, none is empty; `local`, (N, 4): position from the block's center, divided by `radius`, and 1."""

    labels: np.ndarray
    count: int
    local: np.ndarray

    @classmethod
    def over(
        cls, cells: np.ndarray, labels: np.ndarray, count: int, step: float, radius: float, dtype: type = np.float64
    ) -> Blocks:
        """Make blocks from (N, 3) integer cells of the keyframe. A block's center is the mean of its cells, rounded
        down."""
        members = np.maximum(np.bincount(labels, minlength=count), 1)
        sums = np.stack([np.bincount(labels, weights=cells[:, i], minlength=count) for i in range(3)], axis=1)
        centers = np.floor(sums / members[:, None])  # sums are integers below 2^53, so this is exact
        local: np.ndarray = np.ones((len(cells), 4), dtype=dtype)
        local[:, :3] = (cells - centers[labels]) * (step / radius)
        return cls(labels, count, local)

    def fit(self, targets: np.ndarray) -> np.ndarray:
        """(B, 4, 3) affine map of each block to (N, 3) displacements, displacement = local @ map: robust least squares
        (Geman and McClure 1987), so that outliers do not distort the motion of their block."""
        order = np.argsort(self.labels, kind="stable")
        local, target, label = self.local[order], targets[order], self.labels[order]
        members = np.bincount(label, minlength=self.count)
        starts = np.concatenate([[0], np.cumsum(members)[:-1]])
        weights = np.ones(len(order))
        maps = np.zeros((self.count, 4, 3))
        for _ in range(_ITERATIONS):
            weighted = local * weights[:, None]
            normal = np.add.reduceat(weighted[:, :, None] * local[:, None, :], starts, axis=0)
            normal += np.diag([_RIDGE] * 3 + [1e-6])  # keeps flat blocks from growing along their normal
            right = np.add.reduceat(weighted[:, :, None] * target[:, None, :], starts, axis=0)
            maps = np.linalg.solve(normal, right)
            error = np.linalg.norm(target - np.einsum("ni,nik->nk", local, maps[label]), axis=1)
            bounded = np.minimum(error, 4 * np.median(error) + 1e-12)
            spread = np.sqrt(np.add.reduceat(bounded**2, starts) / members)[label] + 1e-12
            weights = (1 + (error / (2 * spread)) ** 2) ** -2.0
        return maps

    def displace(self, maps: np.ndarray) -> np.ndarray:
        """(N, 3) displacements from (B, 4, 3) maps."""
        # column by column: twice as fast as an einsum over small matrices
        numbers = maps.reshape(-1, 12).take(self.labels, axis=0)
        result = np.empty((len(self.labels), 3), dtype=maps.dtype)
        for k in range(3):
            result[:, k] = numbers[:, 9 + k]
            for i in range(3):
                result[:, k] += self.local[:, i] * numbers[:, 3 * i + k]
        return result
