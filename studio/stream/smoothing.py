"""Smoothing of each splat's path over a group: takes out the jitter that training leaves from frame to frame.

The frames of a group are trained one after the other, and each adds errors of its own that only cost bits and make
pictures from new cameras worse. How much of a path is jitter differs: where a performer stands still it is all of it,
in fast motion next to nothing. Each splat is therefore smoothed as strongly as its own path and those of its neighbors
say.
"""

from __future__ import annotations

import numpy as np

STRENGTHS = (0.0, 0.05, 0.2, 0.5, 1.5, 5.0, 20.0, 100.0)
"""Values of the smoothing parameter to choose from; 0 leaves a path as it is."""

NEIGHBORS = 33
"""Splats, in the stream's order, that choose together: the likelihood of one path alone is too noisy."""

_NO_SMOOTHING = 1e-4  # stands for 0, whose likelihood has no limit


def smooth_paths(paths: np.ndarray, keep_first: bool) -> np.ndarray:
    """Smoothed paths: those that minimize the sum of squared changes of values plus strength times the sum of squared
    second differences (Whittaker 1923; Eilers 2003, "A perfect smoother").

    Steady motion has no second difference and stays as it is. The strength of each splat maximizes the marginal
    likelihood of its path and its neighbors' if accelerations and jitter are white noise of unknown variance (Wahba
    1985, generalized maximum likelihood).

    Args:
        paths: (F, N, D) values per frame, splats in the stream's order.
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
    if keep_first:
        start, moving = values[:1], values[1:] - values[:1]
        penalty = penalty[1:, 1:]  # a constant has no second difference, so the start may be subtracted
    else:
        start, moving = np.zeros_like(values[:1]), values
    # In the eigenvectors of the penalty, each coefficient is shrunk by itself.
    roughness, modes = np.linalg.eigh(penalty)
    coefficients = np.einsum("tj,tnd->jnd", modes, moving)
    strengths = _strengths((coefficients**2).sum(axis=2), roughness, values.shape[2])
    coefficients /= 1 + roughness[:, None, None] * strengths[None, :, None]
    smoothed = start + np.einsum("tj,jnd->tnd", modes, coefficients)
    result: np.ndarray = np.concatenate([values[:1], smoothed]) if keep_first else smoothed
    return result


def _strengths(energy: np.ndarray, roughness: np.ndarray, dimensions: int) -> np.ndarray:
    """(N,) the most likely of `STRENGTHS`, from (J, N) squared coefficients and the (J,) eigenvalues of their modes."""
    rough = roughness > 1e-9 * roughness.max()  # the others are straight lines, which say nothing about jitter
    energy, roughness = energy[rough], roughness[rough]
    costs = []
    for strength in STRENGTHS:
        # variance of a coefficient, in units of the jitter's: acceleration shows less in rough modes
        variance = 1 + 1 / (max(strength, _NO_SMOOTHING) * roughness)
        jitter = (energy / variance[:, None]).sum(axis=0)
        costs.append(dimensions * (len(roughness) * np.log(jitter + 1e-30) + np.log(variance).sum()))
    choice = _summed(np.array(costs)).argmin(axis=0)
    result: np.ndarray = np.array(STRENGTHS)[choice]
    return result


def _summed(costs: np.ndarray) -> np.ndarray:
    """(S, N) costs, each the sum over the `NEIGHBORS` splats around it."""
    count = costs.shape[1]
    sums = np.concatenate([np.zeros((len(costs), 1)), np.cumsum(costs, axis=1)], axis=1)
    at, reach = np.arange(count), NEIGHBORS // 2
    result: np.ndarray = sums[:, np.minimum(at + reach + 1, count)] - sums[:, np.maximum(at - reach, 0)]
    return result
