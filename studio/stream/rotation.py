"""Rotations of splats for the profile `motion`: the one of 24 equal forms that lies nearest to no rotation, and the
three numbers that stand for a quaternion.

Quaternions are wxyz, in arrays whose last axis has length 4.
"""

from __future__ import annotations

import itertools

import numpy as np


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product a b of quaternions (first turn by b, then by a); shapes broadcast."""
    aw, ax, ay, az = (a[..., i] for i in range(4))
    bw, bx, by, bz = (b[..., i] for i in range(4))
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse of unit quaternions."""
    return q * np.array([1, -1, -1, -1], dtype=q.dtype)


def to_mrp(q: np.ndarray) -> np.ndarray:
    """Modified Rodrigues parameters (..., 3) = (x, y, z) / (1 + w) of unit quaternions.

    |p| = tan(angle / 4): at most 1 for w >= 0. Schaub and Junkins 1996. The caller keeps w away from -1.
    """
    result: np.ndarray = q[..., 1:] / (1 + q[..., :1])
    return result


def from_mrp(p: np.ndarray) -> np.ndarray:
    """Inverse of `to_mrp`: w = (1 - |p|^2) / (1 + |p|^2), (x, y, z) = 2 p / (1 + |p|^2)."""
    square = (p * p).sum(axis=-1, keepdims=True)
    return np.concatenate([1 - square, 2 * p], axis=-1) / (1 + square)


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
    turned = multiply(multiply(factors[:, None], units), conjugate(factors)[:, None])[..., 1:]
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
        real = np.abs(quats @ conjugate(factor).astype(quats.dtype))
        better = real > best + 1e-6  # the first of equal ones
        best[better], choice[better] = real[better], index
    return CUBE_QUATS[choice], CUBE_AXES[choice]
