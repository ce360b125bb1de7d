"""Splats that turn with the surface they lie on: rotations read off the motion of their neighbors."""

from __future__ import annotations

import torch
from torch import Tensor

from studio.torch_rotations import matrices_to_quats


def neighbors(means: Tensor, count: int) -> Tensor:
    """(N, k) int64: indices of the k = min(count, N - 1) nearest other splats of (N, 3) positions."""
    from scipy.spatial import cKDTree

    array = means.detach().cpu().numpy()
    nearest = cKDTree(array).query(array, k=min(count + 1, len(array)), workers=-1)[1]
    return torch.from_numpy(nearest.reshape(len(array), -1)[:, 1:]).to(means.device)


def local_median(values: Tensor, near: Tensor) -> Tensor:
    """(N, C) medians of each splat's (N, C) values and those of its (N, k) neighbors, channel by channel.

    A median, because near a limb before the body it takes the majority's side where a mean would take neither.
    """
    return torch.cat([values[:, None], values[near]], dim=1).median(dim=1).values


def local_rotations(before: Tensor, after: Tensor, near: Tensor) -> Tensor:
    """(N, 4) unit quaternions, wxyz: how each splat's neighborhood turned from `before` to `after`.

    The rotation that maps the offsets to the neighbors best in least squares (Kabsch 1976), which for a flat
    neighborhood is the one of the two reflections that is a rotation. Splats with fewer than two neighbors do not
    turn.

    Args:
        before, after: (N, 3) positions.
        near: (N, k) neighbors of each splat.
    """
    if near.shape[1] < 2:
        identity = torch.zeros(len(before), 4, dtype=before.dtype, device=before.device)
        identity[:, 0] = 1
        return identity
    old = before[near] - before[:, None]
    new = after[near] - after[:, None]
    u, _, vh = torch.linalg.svd(old.transpose(1, 2) @ new)
    sign = torch.linalg.det(u @ vh).sign()
    u = torch.cat([u[..., :2], u[..., 2:] * sign[:, None, None]], dim=-1)
    return matrices_to_quats((u @ vh).transpose(1, 2))
