"""Coding of the profile `motion`: fixed steps, and ranges that leave a few values to escapes."""

import math

import numpy as np

from studio.stream.attributes import ATTRIBUTES
from studio.stream.settings import BakeSettings

_TAIL = 1e-4  # fraction of values at either end that may become escapes instead of widening the range
_OUTLIERS = 4  # splats at either end that may do so if they would at least double the step, in channels of any size
_MAX_CODE = float(1 << 30)  # of an escape; the side file has 32 bits


def channel_steps(sh_degree: int, position_step: float, typical: float, settings: BakeSettings) -> list[float]:
    """Step of each channel of `attributes.channels(sh_degree)`, before `channel_range`, in world units.

    `position_step` is of residuals of class 1; class 0 has half of it. `typical` is the size of a typical splat. An
    attribute whose QP differs from `qp` has a finer or coarser step, 6 QPs per factor of two.
    """

    result: list[float] = []
    for attribute in ATTRIBUTES:
        base = attribute.steps
        if attribute.name == "means":
            base = (position_step / 2,) * 3
        elif attribute.name == "scales":
            base = tuple(step * math.sqrt(typical) for step in base)
        qp = settings.qp_overrides.get(attribute.qp_name, settings.qp)
        result += [step * 2.0 ** ((qp - settings.qp) / 6) for step in base] * attribute.repeats(sh_degree)
    return result


def channel_range(values: np.ndarray, step: float) -> tuple[float, float]:
    """Offset and step (at least `step`) of a channel: all values if 255 steps hold them, else all but the tails."""
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
