"""Splat rotations in the profile `motion`: the one of 24 equivalent forms that is nearest to the identity.

Quaternions are wxyz, in arrays whose last axis has length 4.
"""

from __future__ import annotations

import itertools

import numpy as np

from studio.rotations import quat_conjugate, quat_multiply


def _cube() -> tuple[np.ndarray, np.ndarray]:
    """The 24 rotations of the cube: quaternions (24, 4), and for each the old axis of each new axis, (24, 3)."""
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
    return factors, np.abs(turned).argmax(axis=-1)  # turned[f, j]: image of axis j under factor f


CUBE_QUATS, CUBE_AXES = _cube()


def nearest_form(quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The permutation of each splat's axes that brings its rotation nearest to the identity.

    For each of the 24 rotations c of the cube, rotation q c with correspondingly permuted scales is the same Gaussian.
    The nearest form is at most 63 degrees from the identity, so that its MRP is small and continuous, and no label
    needs to be stored.

    Args:
        quats: (N, 4) unit quaternions.

    Returns:
        Factors (N, 4), to multiply with quaternions from the right; axes (N, 3): new scale i is old scale axes[i].
    """
    best = np.full(len(quats), -1.0)
    choice = np.zeros(len(quats), dtype=np.int64)
    for index, factor in enumerate(CUBE_QUATS):
        # the angle of q c depends on its real part only
        real = np.abs(quats @ quat_conjugate(factor).astype(quats.dtype))
        better = real > best + 1e-6  # the first of equals
        best[better], choice[better] = real[better], index
    return CUBE_QUATS[choice], CUBE_AXES[choice]
