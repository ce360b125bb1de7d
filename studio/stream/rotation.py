"""Splat rotations in the profile `motion`: the one of 24 equivalent forms that is nearest to the identity.

Quaternions are wxyz, in arrays whose last axis has length 4.
"""

from __future__ import annotations

import itertools

import numpy as np

from studio.rotations import quat_conjugate, quat_multiply


def _cube() -> tuple[np.ndarray, np.ndarray]:
    """The 24 rotations that map the axes onto themselves: quaternions (24, 4) and, for each, which old axis every new
    axis is, (24, 3)."""
    # Up to sign: 4 unit quaternions with one entry, 12 with two of equal size, 8 with four.
    quats: list[np.ndarray] = []
    for entries in itertools.product((1.0, 0.0, -1.0), repeat=4):
        q = np.array(entries)
        first = next((entry for entry in entries if entry), 0.0)
        if np.count_nonzero(q) in (1, 2, 4) and first > 0:
            quats.append(q / np.linalg.norm(q))
    factors = np.array(quats)
    units = np.concatenate([np.zeros((3, 1)), np.eye(3)], axis=1)
    turned = quat_multiply(quat_multiply(factors[:, None], units), quat_conjugate(factors)[:, None])[..., 1:]
    return factors, np.abs(turned).argmax(axis=-1)  # turned[f, j]: where factor f takes axis j


CUBE_QUATS, CUBE_AXES = _cube()


def nearest_form(quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which relabeling of a splat's axes brings its rotation nearest to none.

    A Gaussian does not change if its axes are named differently: with any c of the 24 rotations of the cube, rotation
    q c and the scales in the order `axes` are the same splat. The nearest form is at most 63 degrees away from no
    rotation, so that three small numbers without jumps stand for it and no label need be stored.

    Args:
        quats: (N, 4) unit quaternions.

    Returns:
        factors (N, 4): multiply quaternions by them from the right; axes (N, 3): new scale i is old scale axes[i].
    """
    best = np.full(len(quats), -1.0)
    choice = np.zeros(len(quats), dtype=np.int64)
    for index, factor in enumerate(CUBE_QUATS):
        # the real part of q c alone decides how far it is from no rotation
        real = np.abs(quats @ quat_conjugate(factor).astype(quats.dtype))
        better = real > best + 1e-6  # the first of equal ones
        best[better], choice[better] = real[better], index
    return CUBE_QUATS[choice], CUBE_AXES[choice]
