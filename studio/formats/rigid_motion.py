"""Rotation and scaling of whole splat sets including spherical harmonics, and the axis conventions of other viewers."""

import functools
import math
from dataclasses import replace

import numpy as np
import torch

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer.spherical_harmonics import sh_basis
from v3studio.studio.rotations import matrices_to_quats
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo
from v3studio.studio.torch_rotations import quat_multiply


def turned(gaussians: Gaussians, rotation: np.ndarray) -> Gaussians:
    """Splats rotated about the origin, or mirrored, including their spherical harmonics, by an orthonormal (3, 3)
    `rotation`: new = rotation @ old. A camera rotated with them sees the same image. Quaternions become unit."""
    dtype, device = gaussians.means.dtype, gaussians.device
    matrix = torch.as_tensor(rotation, dtype=torch.float64)
    # splats are symmetric about their centers, so a mirrored one is one turned by minus the matrix
    turn = torch.from_numpy(matrices_to_quats(rotation * np.sign(np.linalg.det(rotation))))[None]
    quats = quat_multiply(turn, gaussians.unit_quats.detach().cpu().double())
    sh = _sh_rotation(matrix, gaussians.sh_degree) @ gaussians.sh.detach().cpu().double()
    means = gaussians.means.detach().cpu().double() @ matrix.T
    return replace(gaussians, means=means.to(device, dtype), quats=quats.to(device, dtype), sh=sh.to(device, dtype))


def scaled(gaussians: Gaussians, factor: float) -> Gaussians:
    """Splats in a world of which one old unit has `factor` new ones, above 0."""
    if factor == 1:
        return gaussians
    return replace(gaussians, means=gaussians.means * factor, log_scales=gaussians.log_scales + math.log(factor))


def moved(gaussians: Gaussians, frame: Similarity) -> Gaussians:
    """Splats in the new world of a frame without rotation, computed with 64 bits; float32."""
    means = gaussians.means.double() * frame.scale + torch.from_numpy(frame.translation)
    return replace(scaled(gaussians, frame.scale), means=means.to(gaussians.means.dtype)).to(torch.float32)


def placed(gaussians: Gaussians, similarity: Similarity) -> Gaussians:
    """Splats of the old world in the new one, including their spherical harmonics: `similarity.camera` sees of them
    what the camera sees of `gaussians`."""
    if similarity.is_identity:
        return gaussians
    moved = scaled(turned(gaussians, similarity.rotation), similarity.scale)
    return replace(moved, means=moved.means + torch.from_numpy(similarity.translation).to(moved.means))


def _sh_rotation(matrix: torch.Tensor, degree: int) -> torch.Tensor:
    """(K, K) float64 matrix that maps SH coefficients of a function to those of the rotated function. The value at d
    moves to R d, so Y(R d) new = Y(d) old for all d. Harmonics up to a given degree are closed under rotation, so
    enough directions determine the matrix, and the least-squares residual is zero."""
    if degree == 0:
        return torch.ones(1, 1, dtype=torch.float64)
    directions = _directions()
    return torch.linalg.lstsq(sh_basis(directions @ matrix.T, degree), sh_basis(directions, degree)).solution


@functools.cache
def _directions(count: int = 64) -> torch.Tensor:
    """(count, 3) unit vectors, evenly distributed over the sphere (Fibonacci spiral)."""
    index = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * index / count
    angle = index * (np.pi * (3 - 5**0.5))
    radius = torch.sqrt(1 - z * z)
    return torch.stack([radius * torch.cos(angle), radius * torch.sin(angle), z], dim=1)


def upright(video: SplatVideo) -> np.ndarray:
    """(3, 3) rotation from the video's world to y up, with the side that faces its view toward +z.

    This is the convention of SPZ, glTF and three.js. If the video has no `up`, -y is assumed, as in 3DGS files.
    """
    up = np.array([0.0, -1.0, 0.0]) if video.up is None else np.asarray(video.up, np.float64) / np.linalg.norm(video.up)
    toward = np.array([0.0, 0.0, -1.0]) if video.view is None else -video.view.forward
    for candidate in (toward, *np.eye(3)):  # a view from straight above does not determine the front
        flat = candidate - up * (candidate @ up)
        if np.linalg.norm(flat) > 0.1:
            break
    back = flat / np.linalg.norm(flat)
    return np.stack([np.cross(up, back), up, back])
