"""Coding of the profile `motion`: rotations as MRP of the nearest equivalent form, YCoCg colors, fixed steps."""

from __future__ import annotations

import itertools
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.rotations import quat_conjugate, quat_multiply
from studio.stream.attributes import ATTRIBUTES, BY_NAME
from studio.stream.layout import scale_floor, tile_side, typical_size
from studio.stream.profiles.coding import CODED, SplatCoding, coded_columns
from studio.stream.settings import BakeSettings
from studio.torch_rotations import quat_multiply as torch_quat_multiply

_TAIL = 1e-4  # fraction of values at either end that may become escapes instead of widening the range
_OUTLIERS = 4  # splats at either end that may do so if they would at least double the step, in channels of any size
_MAX_CODE = float(1 << 30)  # of an escape; the side file has 32 bits

Values = TypeVar("Values", np.ndarray, Tensor)


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
        repeats = (sh_degree + 1) ** 2 if attribute.name == "sh" else 1
        qp = settings.qp_overrides.get(attribute.qp_name, settings.qp)
        result += [step * 2.0 ** ((qp - settings.qp) / 6) for step in base] * repeats
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


class MotionCoding(SplatCoding):
    """Rotations, log scales, opacities and YCoCg coefficients as the profile `motion` codes them.

    Differs from the baker in what only the whole group tells: the equivalent forms of the rotations are chosen on the
    previous frame instead of the keyframe, and the mean rotation of a block, which the side file stores, is not
    subtracted.
    """

    profile = "motion"

    def __init__(self, previous: Gaussians) -> None:
        self.attributes = coded_columns({name: len(BY_NAME[name].channels) for name in CODED}, previous.sh_degree)
        self.pixels = tile_side(len(previous)) ** 2
        self._degree = previous.sh_degree
        device, dtype = previous.device, previous.means.dtype
        quats = previous.unit_quats.detach()
        factors, axes = nearest_form(quats.cpu().double().numpy())
        self._factors = torch.as_tensor(factors, dtype=dtype, device=device)
        self._axes = torch.as_tensor(axes, device=device)
        canonical = torch_quat_multiply(quats, self._factors)
        self._quats = torch.where(canonical[:, :1] < 0, -canonical, canonical)
        extent = float((previous.means.amax(0) - previous.means.amin(0)).max())
        self._floor = scale_floor(typical_size(previous.log_scales.detach().cpu().numpy().T, extent))

    def coded_values(self, gaussians: Gaussians) -> Tensor:
        """See `SplatCoding`. Axes and quaternion signs are those nearest to the previous frame."""
        quats = torch_quat_multiply(gaussians.unit_quats, self._factors)
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
        """See `SplatCoding`. Each splat keeps its canonical axes, which render alike."""
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
