"""The table of what the stream stores of each splat: names, order, bits, steps, and how values become those of splats.

Encoder, decoder, manifest and the training losses read it. A splat's own numbers are its *components*; what the stream
stores of them are *channels*, each with a step. `docs/stream.schema.json` has their names, for the player. Means and
rotations follow blocks that move, in `encode/group.py` and `decoder.py`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np

VERSION: Final = 5  # of the stream; raised whenever the meaning of its bytes changes
MAX_VALUE = 1e9  # largest magnitude of any value

MAX_SHAPE = 1e4
"""Largest magnitude of a number of a splat's shape, the square root of a size: three of these make a size below 1e9."""

OPACITY_MARGIN = 1e-6  # opacities are clamped to this distance from 0 and 1, so that their logits are finite

Values: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Converts values of an attribute; the array keeps its shape and dtype."""


def _same(values: np.ndarray) -> np.ndarray:
    return values


def _sigmoid(values: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):  # exp overflows to inf and the result is 0, as intended
        return 1 / (1 + np.exp(-values))


def _logit(opacities: np.ndarray) -> np.ndarray:
    opacities = np.clip(opacities, OPACITY_MARGIN, 1 - OPACITY_MARGIN)
    return np.log(opacities / (1 - opacities))


def to_ycocg(colors: np.ndarray) -> np.ndarray:
    """Luma, orange and green chroma of red, green and blue, which alternate in the rows of (..., 3K, N)."""
    red, green, blue = (colors[..., row::3, :] for row in range(3))
    converted = np.empty_like(colors)
    converted[..., 0::3, :] = (red + 2 * green + blue) / 4
    converted[..., 1::3, :] = (red - blue) / 2
    converted[..., 2::3, :] = (2 * green - red - blue) / 4
    return converted


def from_ycocg(values: np.ndarray) -> np.ndarray:
    """Inverse of `to_ycocg`."""
    luma, orange, green = (values[..., row::3, :] for row in range(3))
    colors = np.empty_like(values)
    colors[..., 0::3, :] = luma + orange - green
    colors[..., 1::3, :] = luma + green
    colors[..., 2::3, :] = luma - orange - green
    return colors


QpAttribute = Literal["means", "opacities", "scales", "sh"]
"""Attributes that can have a QP of their own; `scales` is both scale and rotation."""


@dataclass(frozen=True)
class Attribute:
    """One attribute of a splat."""

    name: Literal["means", "quats", "scales", "opacities", "sh"]  # also in the player's arrays
    tensor: str  # in `Gaussians`
    shape: tuple[int, ...]  # of a splat in that tensor; -1: SH coefficients
    channels: tuple[str, ...]  # names; {k} stands for each SH coefficient
    # of the channels. An error of one step is about equally visible in every channel (found by rendering trained groups
    # with one attribute coarsened at a time). For means, relative to the size of a typical splat; for scales, to its
    # square root
    steps: tuple[float, ...]
    activate: Values = _same  # activate, inverse: from the tensor to components, and back
    inverse: Values = _same
    # to_channels, from_channels: from components to channels, rows of (..., C, N), and back
    to_channels: Values = _same
    from_channels: Values = _same

    def repeats(self, sh_degree: int) -> int:
        """The number of times that its channels occur: once, or once for each SH coefficient."""
        return (sh_degree + 1) ** 2 if -1 in self.shape else 1

    def tensor_shape(self, splats: int, sh_degree: int) -> list[int]:
        """The shape of the tensor of all splats."""
        return [splats, *(self.repeats(sh_degree) if size == -1 else size for size in self.shape)]


ATTRIBUTES = (
    Attribute(
        "means", "means", (3,),
        ("residual_x", "residual_y", "residual_z"), (0.08,) * 3,
    ),
    Attribute(
        "quats", "quats", (4,),
        (), (),  # shape_xx to shape_yz have both rotation and scale
    ),
    Attribute(
        "scales", "log_scales", (3,),
        ("shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz"), (0.011,) * 3 + (0.008,) * 3,
    ),
    Attribute(
        "opacities", "logit_opacities", (),
        ("opacity",), (0.0096,),
        activate=_sigmoid, inverse=_logit,
    ),
    Attribute(
        "sh", "sh", (-1, 3),
        ("sh_{k}_y", "sh_{k}_co", "sh_{k}_cg"), (0.0069, 0.0072, 0.0072),
        to_channels=to_ycocg, from_channels=from_ycocg,
    ),
)  # fmt: skip

BY_NAME: dict[str, Attribute] = {attribute.name: attribute for attribute in ATTRIBUTES}
NAMES: dict[str, list[str]] = {one.name: list(one.channels) for one in ATTRIBUTES if one.channels}
"""Channels of each attribute, in the order of the manifest. Nothing else depends on this order."""

_COMPONENTS = ("means", "sh", "opacities", "scales", "quats")


def value_bounds(channel: str) -> tuple[float, float]:
    """The least and the largest value of a channel that can be rendered."""
    most = MAX_SHAPE if channel in BY_NAME["scales"].channels else MAX_VALUE
    return -most, most


def channels(sh_degree: int) -> tuple[str, ...]:
    """All channels, in the order of the manifest."""
    return tuple(
        name.format(k=k)
        for attribute, names in NAMES.items()
        for k in range(BY_NAME[attribute].repeats(sh_degree))
        for name in names
    )


def channel_rows(sh_degree: int) -> dict[str, slice]:
    """Rows of each attribute among the channels."""
    return _rows({name: len(names) * BY_NAME[name].repeats(sh_degree) for name, names in NAMES.items()})


def component_rows(sh_degree: int) -> dict[str, slice]:
    """Rows of each attribute among the components, the numbers of its tensor."""
    return _rows({name: math.prod(BY_NAME[name].tensor_shape(1, sh_degree)) for name in _COMPONENTS})


def _rows(sizes: dict[str, int]) -> dict[str, slice]:
    rows, start = {}, 0
    for attribute, size in sizes.items():
        rows[attribute] = slice(start, start + size)
        start += size
    return rows
