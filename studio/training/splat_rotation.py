"""Rotates splats with the surface they are on: rotations estimated from the motion of neighboring splats."""

from __future__ import annotations

import torch
from torch import Tensor


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

    The least-squares rotation of the offsets to the neighbors (Kabsch 1976), with the reflection excluded for flat
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
    return quaternions((u @ vh).transpose(1, 2))


def quaternions(rotations: Tensor) -> Tensor:
    """(N, 3, 3) rotation matrices to (N, 4) unit quaternions, wxyz, w >= 0 (Shepperd 1978: the largest part first)."""
    m = rotations
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    squares = torch.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], 1)
    wx, wy, wz = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 1, 0] + m[:, 0, 1], m[:, 0, 2] + m[:, 2, 0], m[:, 2, 1] + m[:, 1, 2]
    # row i: 4 q_i q; all rows are multiples of q, the one with the largest q_i has the most digits
    rows = torch.stack(
        [
            torch.stack([squares[:, 0], wx, wy, wz], 1),
            torch.stack([wx, squares[:, 1], xy, xz], 1),
            torch.stack([wy, xy, squares[:, 2], yz], 1),
            torch.stack([wz, xz, yz, squares[:, 3]], 1),
        ],
        dim=1,
    )
    best = rows[torch.arange(len(m), device=m.device), squares.argmax(1)]
    best = torch.nn.functional.normalize(best, dim=-1)
    return torch.where(best[:, :1] < 0, -best, best)


def multiply(left: Tensor, right: Tensor) -> Tensor:
    """(N, 4) quaternion products, wxyz: first `right`, then `left` turns."""
    a, b = left[:, :1], left[:, 1:]
    c, d = right[:, :1], right[:, 1:]
    return torch.cat([a * c - (b * d).sum(-1, keepdim=True), a * d + c * b + torch.linalg.cross(b, d)], dim=-1)


def rotate(quats: Tensor, vectors: Tensor) -> Tensor:
    """(N, 3) vectors turned by (N, 4) unit quaternions, wxyz."""
    scalar, axis = quats[:, :1], quats[:, 1:]
    twist = 2 * torch.linalg.cross(axis, vectors)
    return vectors + scalar * twist + torch.linalg.cross(axis, twist)
