"""Paths of splats over a group, before they are encoded.

Hidden splats: nothing in training stops those that are too faint to be rendered, since they have no gradients. Where
they have strayed from the performer, the video's coding error can make them opaque enough to be seen, and their paths
cost bits. They are moved with their surroundings.

Smoothing takes out the jitter that training leaves from frame to frame. The frames of a group are trained one after the
other, and each adds errors of its own that only cost bits and make images from new cameras worse. How much of a path is
jitter differs: where a performer stands still it is all of it, in fast motion next to nothing. Each splat is therefore
smoothed as strongly as its own path and those of its neighbors suggest, given how large jitter can be.
"""

import numpy as np
from scipy.spatial import cKDTree

from v3studio.studio.rasterizer.types import ALPHA_MIN

STRENGTHS = (0.0, 0.05, 0.2, 0.5, 1.5, 5.0, 20.0, 100.0)
"""Values of the smoothing parameter to choose from; 0 leaves a path as it is."""

NEIGHBORS = 33  # splats, in the stream's order, that choose together: the likelihood of one path alone is too noisy

_NO_SMOOTHING = 1e-6  # stands for 0, whose likelihood has no limit


def carry_hidden_splats(positions: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """Move splats that a frame does not show like the visible splat that is nearest in the keyframe.

    Takes (F, N, 3) means, keyframe first, world units, and (F, N) opacities, 0 to 1. Returns means: those of visible
    splats and of the keyframe are unchanged. `positions` itself if nothing changes.
    """
    carried = positions
    for frame in range(1, len(positions)):
        hidden = opacities[frame] < ALPHA_MIN
        if not hidden.any() or hidden.all():
            continue
        if carried is positions:
            carried = positions.copy()
        visible = np.flatnonzero(~hidden)
        nearest = visible[cKDTree(positions[0, visible]).query(positions[0, hidden])[1]]
        carried[frame, hidden] = positions[0, hidden] + positions[frame, nearest] - positions[0, nearest]
    return carried


def smooth_paths(paths: np.ndarray, jitter: np.ndarray | float, keep_first: bool) -> np.ndarray:
    """Smoothed paths: those that minimize the sum of squared changes of values plus strength times the sum of squared
    second differences (Whittaker 1923; Eilers 2003, "A perfect smoother").

    Steady motion has no second difference and stays as it is. The strength of each splat maximizes the marginal
    likelihood of its path and its neighbors', if accelerations are white noise of unknown variance and jitter is white
    noise of a known one (Wahba 1985, generalized maximum likelihood). Were the jitter's variance unknown as well, fast
    motion that the frames sample too coarsely would pass for jitter.

    Args:
        paths: (F, N, D) values per frame, splats in the stream's order.
        jitter: (N,) standard deviation of the jitter of each splat in units of `paths`, above 0, or one for all.
        keep_first: keep the values of the first frame. The others are smoothed with it as a fixed start.

    Returns:
        (F, N, D) float64. Fewer than four frames are returned as they are.
    """
    values = paths.astype(np.float64)
    frames = len(values)
    if frames < 4:
        return values
    second = np.diff(np.eye(frames), n=2, axis=0)
    penalty = second.T @ second
    start = values[:1]
    if keep_first:
        penalty = penalty[1:, 1:]  # a constant has no second difference, so the start may be subtracted
    # In the eigenvectors of the penalty, each coefficient is shrunk by itself.
    roughness, modes = np.linalg.eigh(penalty)
    coefficients = np.tensordot(modes.T, values[1:] - start if keep_first else values, axes=1)
    energy = (coefficients**2).sum(axis=2) / np.square(jitter)
    coefficients /= 1 + roughness[:, None, None] * _strengths(energy, roughness, values.shape[2])[None, :, None]
    smoothed: np.ndarray = np.tensordot(modes, coefficients, axes=1)
    return np.concatenate([start, start + smoothed]) if keep_first else smoothed


def _strengths(energy: np.ndarray, roughness: np.ndarray, dimensions: int) -> np.ndarray:
    """(N,) the most likely of `STRENGTHS`, from (J, N) squared coefficients in units of the jitter's variance and the
    (J,) eigenvalues of their modes."""
    rough = roughness > 1e-9 * roughness.max()  # the others are straight lines, which say nothing about jitter
    energy, roughness = energy[rough], roughness[rough]
    costs = []
    for strength in STRENGTHS:
        # variance of a coefficient: acceleration shows less in rough modes
        variance = 1 + 1 / (max(strength, _NO_SMOOTHING) * roughness)
        costs.append((energy / variance[:, None]).sum(axis=0) + dimensions * np.log(variance).sum())
    result: np.ndarray = np.array(STRENGTHS)[_summed(np.array(costs)).argmin(axis=0)]
    return result


def _summed(costs: np.ndarray) -> np.ndarray:
    """(S, N) costs, each the sum over the `NEIGHBORS` splats around it."""
    count = costs.shape[1]
    sums = np.concatenate([np.zeros((len(costs), 1)), np.cumsum(costs, axis=1)], axis=1)
    at, reach = np.arange(count), NEIGHBORS // 2
    result: np.ndarray = sums[:, np.minimum(at + reach + 1, count)] - sums[:, np.maximum(at - reach, 0)]
    return result
