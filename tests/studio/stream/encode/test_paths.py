"""Smoothing of paths against closed forms and known motions; invisible splats."""

import itertools

import numpy as np
import pytest

from v3studio.studio.stream.encode import paths as paths_module
from v3studio.studio.stream.encode.paths import STRENGTHS, carry_hidden_splats, smooth_paths


def noise(*shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def second_differences(frames):
    rows = np.zeros((frames - 2, frames))
    for row in range(frames - 2):
        rows[row, row : row + 3] = 1, -2, 1
    return rows


def minimum(path, strength, keep_first):
    """The path that minimizes the sum in the docstring, by least squares over the stacked equations."""
    frames = len(path)
    equations = np.concatenate([np.eye(frames), np.sqrt(strength) * second_differences(frames)])
    right = np.concatenate([path, np.zeros(frames - 2)])
    if not keep_first:
        return np.linalg.lstsq(equations, right, rcond=None)[0]
    rest = np.linalg.lstsq(equations[1:, 1:], (right - equations[:, 0] * path[0])[1:], rcond=None)[0]
    return np.concatenate([path[:1], rest])


@pytest.mark.parametrize("keep_first", [True, False])
@pytest.mark.parametrize("strength", [0.2, 5.0, 100.0])
def test_a_path_is_the_minimum(monkeypatch: pytest.MonkeyPatch, strength: float, keep_first: bool) -> None:
    monkeypatch.setattr(paths_module, "STRENGTHS", (strength,))
    paths = noise(9, 4, 3)
    smooth = smooth_paths(paths, 1.0, keep_first)
    for splat, axis in itertools.product(range(4), range(3)):
        assert np.abs(smooth[:, splat, axis] - minimum(paths[:, splat, axis], strength, keep_first)).max() < 1e-9


def test_the_strength_is_the_most_likely_one() -> None:
    """The strength is judged by the density of second differences, which are those of white jitter added to white
    accelerations."""
    from scipy.stats import multivariate_normal  # takes a second, in every process that collects tests

    frames, jitter = 12, 0.3
    rows = second_differences(frames)
    chosen = set()
    for seed, acceleration in enumerate((0.01, 0.1, 1.0, 10.0)):
        paths = acceleration * np.cumsum(np.cumsum(noise(frames, 6, 3, seed=seed), axis=0), axis=0)
        paths += jitter * noise(frames, 6, 3, seed=100 + seed)
        likelihoods = []
        for strength in STRENGTHS:
            covariance = jitter**2 * (rows @ rows.T + np.eye(frames - 2) / max(strength, 1e-6))
            changes = rows @ paths.reshape(frames, -1)
            likelihoods.append(multivariate_normal(np.zeros(frames - 2), covariance).logpdf(changes.T).sum())
        strength = STRENGTHS[int(np.argmax(likelihoods))]
        chosen.add(strength)
        smooth = smooth_paths(paths, np.full(6, jitter), keep_first=False)
        want = np.stack([minimum(path, strength, False) for path in paths.reshape(frames, -1).T], axis=1)
        assert np.abs(smooth.reshape(frames, -1) - want).max() < 1e-8
    assert len(chosen) > 1


def test_hidden_splats_take_the_motion_of_their_surroundings() -> None:
    generator = np.random.default_rng(1)
    keyframe = generator.uniform(-1, 1, (300, 3))
    left = keyframe[:, 0] < 0
    shift = np.where(left[:, None], (0.0, 0.3, 0.0), (0.1, 0.0, 0.0))
    positions = np.stack([keyframe, keyframe + shift, keyframe + 2 * shift])
    opacities = np.full((3, 300), 0.2)
    lost = np.flatnonzero(np.abs(keyframe[:, 0]) > 0.5)[:20]
    positions[1:, lost] += 7.0
    opacities[1:, lost] = 0.0025
    carried = carry_hidden_splats(positions, opacities)
    np.testing.assert_allclose(carried, [keyframe, keyframe + shift, keyframe + 2 * shift], atol=1e-12)
    seen = opacities >= 1 / 255
    np.testing.assert_array_equal(carried[seen], positions[seen])
