"""Coding of the profile `motion`: rotations as MRP of the nearest equivalent form, fixed steps."""

from __future__ import annotations

import itertools

import numpy as np

from studio.rotations import quat_conjugate, quat_multiply
from studio.stream.attributes import ATTRIBUTES
from studio.stream.settings import BakeSettings

_TAIL = 1e-4  # fraction of values at either end that may become escapes instead of widening the range
_OUTLIERS = 4  # splats at either end that may do so if they would at least double the step, in channels of any size
_MAX_CODE = float(1 << 30)  # of an escape; the side file has 32 bits


def channel_steps(sh_degree: int, position_step: float, settings: BakeSettings) -> list[float]:
    """Step of each channel of `attributes.channels(sh_degree)`, before `channel_range`.

    Args:
        sh_degree: 0 to 3.
        position_step: step of position residuals of class 1, world units; class 0 has half of it.
        settings: an attribute whose QP differs from `qp` has a finer or coarser step, 6 QPs per factor of two.
    """

    result: list[float] = []
    for attribute in ATTRIBUTES:
        base: tuple[float, ...] = (position_step / 2,) * 3 if attribute.name == "means" else attribute.steps
        qp = settings.qp_overrides.get(attribute.qp_name, settings.qp)
        result += [step * 2.0 ** ((qp - settings.qp) / 6) for step in base] * attribute.repeats(sh_degree)
    return result


def channel_range(values: np.ndarray, step: float) -> tuple[float, float]:
    """Offset and step of a channel: the whole range if 255 steps hold it, otherwise all but the tails.

    Args:
        values: (N,) of one frame, or (F, N) of a group.
        step: the finest step that is wanted.
    """
    least, most = low, high = float(values.min()), float(values.max())
    if high - low > 254 * step:
        low, high = (float(end) for end in np.quantile(values, [_TAIL, 1 - _TAIL]))
        inner = _without_outliers(values)
        if high - low > 2 * max(inner[1] - inner[0], 254 * step):
            low, high = inner
    return (low + high) / 2, max(step, (high - low) / 254, (most - least) / _MAX_CODE)


def _without_outliers(values: np.ndarray) -> tuple[float, float]:
    """Range of the values without a few splats that are far from all others: farther than the range of these."""
    splats = values.reshape(-1, values.shape[-1])
    if splats.shape[1] <= 2 * _OUTLIERS:
        return float(values.min()), float(values.max())
    low = float(np.partition(splats.min(axis=0), _OUTLIERS)[_OUTLIERS])
    high = float(np.partition(splats.max(axis=0), -_OUTLIERS - 1)[-_OUTLIERS - 1])
    width = high - low
    near = splats[(splats >= low - width) & (splats <= high + width)]
    return float(near.min()), float(near.max())


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
