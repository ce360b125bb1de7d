"""Splats like trained ones, and how much of each attribute a stream loses."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from v3studio.studio.gaussians import Gaussians


def performer(frames: int, splats: int = 900) -> list[Gaussians]:
    """A drifting cloud like trained splats: median opacity 0.15, sizes about 0.01, colors smooth in space."""
    random = np.random.RandomState(5)  # NumPy never changes what it returns

    def noise(*shape: int) -> torch.Tensor:
        return torch.from_numpy(random.standard_normal(shape).astype(np.float32))

    means = torch.from_numpy(random.random_sample((splats, 3)).astype(np.float32)) - 0.5
    turns = torch.cat([torch.ones(splats, 1), 0.05 * noise(splats, 3)], dim=1)
    scales = math.log(0.01) + 0.3 * noise(splats, 3)
    logits = math.log(0.15 / 0.85) + 0.5 * noise(splats)
    wave = torch.sin(4 * means)
    sh = torch.cat([0.3 * wave[:, None], 0.05 * wave[:, None].roll(1, dims=2).repeat(1, 3, 1)], dim=1)
    return [
        Gaussians(means + torch.tensor([0.004 * t, 0.0, 0.002 * t * t]), turns, scales, logits, sh + 0.002 * t)
        for t in range(frames)
    ]


def attribute_errors(frames: Sequence[Gaussians], decoded: Sequence[Gaussians]) -> dict[str, float]:
    """Root mean square error over all frames: means in world units, opacity, SH, covariance relative to its trace."""
    index = linear_sum_assignment(cdist(_looks(decoded[0]), _looks(frames[0])))[1]
    squares: dict[str, list[np.ndarray]] = {name: [] for name in ("means", "opacity", "sh", "covariance")}
    for frame, found in zip(frames, decoded, strict=True):
        truth = frame[torch.from_numpy(index)]
        squares["means"].append((truth.means - found.means).square().numpy().ravel())
        squares["opacity"].append((truth.opacities - found.opacities).square().numpy())
        squares["sh"].append((truth.sh - found.sh).square().numpy().ravel())
        one, two = covariances(truth), covariances(found)
        error = np.linalg.norm(one - two, axis=(1, 2)) / np.trace(one, axis1=1, axis2=2)
        squares["covariance"].append(error**2)
    return {name: float(np.sqrt(np.concatenate(parts).mean())) for name, parts in squares.items()}


def covariances(gaussians: Gaussians) -> np.ndarray:
    """(N, 3, 3), independent of the order of a splat's axes."""
    turns = Rotation.from_quat(gaussians.quats.numpy(), scalar_first=True).as_matrix()
    axes = turns * gaussians.scales.numpy()[:, None]
    return axes @ axes.transpose(0, 2, 1)


def _looks(gaussians: Gaussians) -> np.ndarray:
    """(N, 6) what identifies a splat that was coded coarsely, in units of what coding may change."""
    sizes = gaussians.log_scales.mean(dim=1) / 0.1
    colors = gaussians.sh[:, 0, :1] / 0.03
    columns = [gaussians.means / 0.001, gaussians.opacities[:, None] / 0.03, sizes[:, None], colors]
    return torch.cat(columns, dim=1).numpy()
