"""Rotates splats with the surface they represent, by rotations estimated from the motion of neighboring splats."""

from __future__ import annotations

import torch
from torch import Tensor

from studio.torch_rotations import matrices_to_quats


def neighbors(means: Tensor, count: int) -> Tensor:
    """(N, k) int64 indices of the k = min(count, N - 1) nearest other splats, from (N, 3) means."""
    from scipy.spatial import cKDTree

    array = means.detach().cpu().numpy()
    nearest = cKDTree(array).query(array, k=min(count + 1, len(array)), workers=-1)[1]
    return torch.from_numpy(nearest.reshape(len(array), -1)[:, 1:]).to(means.device)


def local_median(values: Tensor, near: Tensor) -> Tensor:
    """(N, C) per-channel medians of the (N, C) values of each splat and its (N, k) neighbors.

    At motion boundaries, such as a limb in front of the body, a median follows one side; a mean would blend both.
    """
    return torch.cat([values[:, None], values[near]], dim=1).median(dim=1).values


def local_rotations(before: Tensor, after: Tensor, near: Tensor) -> Tensor:
    """(N, 4) unit quaternions, wxyz: the rotation of each splat's neighborhood from `before` to `after`.

    This is the least-squares rotation of the offsets to the neighbors (Kabsch 1976), with reflections excluded for flat
    neighborhoods. Splats with fewer than two neighbors get the identity.

    Args:
        before, after: (N, 3) means.
        near: (N, k) indices of the neighbors.
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
