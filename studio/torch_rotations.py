"""Rotations in torch: quaternions wxyz and matrices, with gradients, on any device and in any floating dtype.

Quaternions are (w, x, y, z) with the scalar first. The order of operations must not change: trained splats, and with
them the stream's bytes, depend on it. The NumPy counterparts are in `studio.rotations`.
"""

from functools import cache

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor


def quats_to_matrices(quats: Tensor) -> Tensor:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4) wxyz of any norm above 0."""
    w, x, y, z = (quats / quats.norm(dim=-1, keepdim=True)).unbind(-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return torch.stack(rows, dim=-2)


def quat_multiply(left: Tensor, right: Tensor) -> Tensor:
    """Hamilton product (N, 4) wxyz: the rotation `right` followed by `left`. (1, 4) broadcasts against (N, 4)."""
    a, b = left[:, :1], left[:, 1:]
    c, d = right[:, :1], right[:, 1:]
    return torch.cat([a * c - (b * d).sum(-1, keepdim=True), a * d + c * b + torch.linalg.cross(b, d)], dim=-1)


def rotate_vectors(quats: Tensor, vectors: Tensor) -> Tensor:
    """Vectors (N, 3) rotated by unit quaternions (N, 4) wxyz."""
    scalar, axis = quats[:, :1], quats[:, 1:]
    twist = 2 * torch.linalg.cross(axis, vectors)
    return vectors + scalar * twist + torch.linalg.cross(axis, twist)


def align_axes(quats: Tensor, scales: Tensor, reference: Tensor) -> tuple[Tensor, Tensor]:
    """Rename the axes of ellipsoids so that each rotation is as close as possible to a reference.

    An ellipsoid has 24 equivalent rotations, with its scales in different orders. Without this, values between two
    frames would mix different axes. Takes and returns quaternions (N, 4) wxyz of unit length, the new ones each with a
    positive dot product with its reference, and (N, 3) scales of any kind, also logarithms.
    """
    renamings, order = (tensor.to(quats.device) for tensor in _renamings())
    conjugate = reference * reference.new_tensor([1, -1, -1, -1])
    difference = quat_multiply(conjugate, quats)
    angles = (difference * difference.new_tensor([1, -1, -1, -1])) @ renamings.to(quats.dtype).T  # scalar parts
    best = angles.abs().argmax(-1)
    aligned = quat_multiply(quats, renamings.to(quats.dtype)[best])
    opposite = (aligned * reference).sum(-1, keepdim=True) < 0
    return torch.where(opposite, -aligned, aligned), scales.gather(-1, order[best])


@cache
def _renamings() -> tuple[Tensor, Tensor]:
    """The 24 rotations of a cube: quaternions (24, 4) wxyz, and which axis becomes each axis (24, 3)."""
    group = Rotation.create_group("O")
    quats = torch.from_numpy(group.as_quat()[:, [3, 0, 1, 2]])
    return quats, torch.from_numpy(abs(group.as_matrix()).argmax(axis=1))
