"""Coding of the profile `motion`: rotations as MRP of the nearest equivalent form, YCoCg colors, fixed steps."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.stream.layout import scale_floor, tile_side, typical_size
from studio.stream.profiles.coding import SplatCoding
from studio.stream.rotation import nearest_form
from studio.stream.settings import BakeSettings
from studio.torch_rotations import quat_multiply

# An error of one step is about equally visible in every channel. Found by drawing trained groups with one attribute
# coarsened at a time.
POSITION_STEP = 0.08
"""Relative to the size of a typical splat."""

ROTATION_STEP = 0.0015
SCALE_STEP = 0.017
OPACITY_STEP = 0.0096
LUMA_STEP = 0.0069
CHROMA_STEP = 0.0072

_TAIL = 1e-4  # fraction of values at either end that may become escapes instead of widening the range
_OUTLIERS = 4  # splats at either end that may do so if they would at least double the step, in channels of any size
_MAX_CODE = float(1 << 30)  # of an escape; the side file has 32 bits

Values = TypeVar("Values", np.ndarray, Tensor)


def channel_steps(sh_degree: int, position_step: float, settings: BakeSettings) -> list[float]:
    """Step of each channel of `layout.channels(sh_degree)`, before `channel_range`.

    Args:
        sh_degree: 0 to 3.
        position_step: step of position residuals of class 1, world units.
        settings: an attribute whose QP differs from `qp` has a finer or coarser step, 6 QPs per factor of two.
    """

    def step(base: float, attribute: str) -> float:
        qp = settings.qp_overrides.get(attribute, settings.qp)
        return base * 2.0 ** ((qp - settings.qp) / 6)

    result = [step(position_step / 2, "means_low")] * 3  # class 0; most splats have class 1
    result += [step(ROTATION_STEP, "quats")] * 3
    result += [step(SCALE_STEP, "scales")] * 3
    result.append(step(OPACITY_STEP, "opacities"))
    for _ in range((sh_degree + 1) ** 2):
        result += [step(LUMA_STEP, "sh"), step(CHROMA_STEP, "sh"), step(CHROMA_STEP, "sh")]
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


def to_ycocg(red: Values, green: Values, blue: Values) -> tuple[Values, Values, Values]:
    """Luma, orange and green chroma of a color or an SH coefficient."""
    return (red + 2 * green + blue) / 4, (red - blue) / 2, (2 * green - red - blue) / 4


def from_ycocg(luma: Values, orange: Values, green: Values) -> tuple[Values, Values, Values]:
    """Inverse of `to_ycocg`: red, green, blue."""
    return luma + orange - green, luma + green, luma - orange - green


class MotionCoding(SplatCoding):
    """Rotations, log scales, opacities and YCoCg coefficients as the profile `motion` codes them.

    Differs from the baker in what only the whole group tells: the equivalent forms of the rotations are chosen on the
    previous frame instead of the keyframe, and the mean rotation of a block, which the side file stores, is not
    subtracted.
    """

    profile = "motion"

    def __init__(self, previous: Gaussians) -> None:
        self.attributes = {
            "rotation": slice(0, 3),
            "scale": slice(3, 6),
            "opacity": slice(6, 7),
            "color": slice(7, 10),
        }
        if previous.sh_degree > 0:
            self.attributes["sh"] = slice(10, 7 + 3 * (previous.sh_degree + 1) ** 2)
        self.pixels = tile_side(len(previous)) ** 2
        self._degree = previous.sh_degree
        device, dtype = previous.device, previous.means.dtype
        quats = previous.unit_quats.detach()
        factors, axes = nearest_form(quats.cpu().double().numpy())
        self._factors = torch.as_tensor(factors, dtype=dtype, device=device)
        self._axes = torch.as_tensor(axes, device=device)
        canonical = quat_multiply(quats, self._factors)
        self._quats = torch.where(canonical[:, :1] < 0, -canonical, canonical)
        extent = float((previous.means.amax(0) - previous.means.amin(0)).max())
        self._floor = scale_floor(typical_size(previous.log_scales.detach().cpu().numpy().T, extent))

    def coded_values(self, gaussians: Gaussians) -> Tensor:
        """See `SplatCoding`. Axes and quaternion signs are those nearest to the previous frame."""
        quats = quat_multiply(gaussians.unit_quats, self._factors)
        sign = torch.where((quats.detach() * self._quats).sum(-1, keepdim=True) < 0, -1.0, 1.0)
        quats = quats * sign
        rotation = quats[:, 1:] / (1 + quats[:, :1])
        scales = gaussians.log_scales.gather(1, self._axes).clamp_min(self._floor)
        colors = torch.stack(to_ycocg(*gaussians.sh.unbind(-1)), dim=-1)
        return torch.cat([rotation, scales, gaussians.opacities[:, None], colors.flatten(1)], dim=1)

    def quantizer(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """See `SplatCoding`. Steps are the baker's with all attributes at the same QP."""
        steps = channel_steps(self._degree, 0.0, BakeSettings(profile="motion"))[3:]
        columns = values.detach().cpu().double().numpy().T
        found = np.array([channel_range(column, step) for column, step in zip(columns, steps, strict=True)])
        offsets, widths = torch.as_tensor(
            found, dtype=values.dtype, device=values.device
        ).T.contiguous()  # kernels read rows
        return offsets, widths

    def decode(self, gaussians: Gaussians, values: Tensor) -> Gaussians:
        """See `SplatCoding`. Each splat keeps its canonical axes, which draw the same picture."""
        rotation = values[:, :3]
        square = (rotation * rotation).sum(-1, keepdim=True)
        colors = values[:, 7:].reshape(gaussians.sh.shape)
        return Gaussians(
            gaussians.means,
            torch.cat([1 - square, 2 * rotation], dim=1) / (1 + square),
            values[:, 3:6],
            torch.logit(values[:, 6].clamp(1e-4, 1 - 1e-4)),
            torch.stack(from_ycocg(*colors.unbind(-1)), dim=-1),
            gaussians.dilation,
        )
