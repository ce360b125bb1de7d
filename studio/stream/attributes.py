"""The table of what the stream stores of each splat: names, order, bits, steps, and how values become those of splats.

The encoders, the decoders, the manifest and the training losses read it. In `planes`, each number of a splat is a
*component* with a range; in `motion`, each is a *channel* with a step. `docs/stream.schema.json` has the names, for
the player. Means and rotations follow blocks that move, in `encode/motion.py` and `decoders/motion.py`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np

VERSION: Final = 4  # of the stream; raised whenever the meaning of its bytes changes
MAX_VALUE = 1e9  # largest magnitude of any value

MAX_LOG_SCALE = math.log(MAX_VALUE)

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


QpAttribute = Literal["means_low", "opacities", "scales", "quats", "sh"]
"""Attributes that can have a QP of their own; `means_low`: the low bytes of the means, or their residuals."""


@dataclass(frozen=True)
class Attribute:
    """One attribute of a splat."""

    name: Literal["means", "quats", "scales", "opacities", "sh"]  # also in the player's arrays
    label: str
    tensor: str  # in `Gaussians`
    shape: tuple[int, ...]  # of a splat in that tensor; -1: SH coefficients
    components: tuple[str, ...]  # names in `planes`; {k} stands for each SH coefficient
    channels: tuple[str, ...]  # names in `motion`, likewise
    # of the channels. An error of one step is about equally visible in every channel (found by rendering trained groups
    # with one attribute coarsened at a time). For means, relative to the size of a typical splat; for scales, to its
    # square root
    steps: tuple[float, ...]
    bits: int = 8  # of a component: 16, in two planes, or 8
    held: bool = False  # whether `planes` keeps it at QP 22 where the QP is higher (paper, "Compression QP Setting")
    largest: float = MAX_VALUE  # the largest value of a component that can be rendered
    activate: Values = _same  # activate, inverse: from the tensor to components, and back
    inverse: Values = _same
    # to_channels, from_channels: from components to channels, rows of (..., C, N), and back
    to_channels: Values = _same
    from_channels: Values = _same

    @property
    def qp_name(self) -> QpAttribute:
        """Its name in `attribute_qps`."""
        return "means_low" if self.name == "means" else self.name

    def repeats(self, sh_degree: int) -> int:
        """The number of times that its components and channels occur: once, or once for each SH coefficient."""
        return (sh_degree + 1) ** 2 if -1 in self.shape else 1

    def tensor_shape(self, splats: int, sh_degree: int) -> list[int]:
        """The shape of the tensor of all splats."""
        return [splats, *(self.repeats(sh_degree) if size == -1 else size for size in self.shape)]


ATTRIBUTES = (
    Attribute(
        "means", "positions", "means", (3,),
        ("mean_x", "mean_y", "mean_z"), ("residual_x", "residual_y", "residual_z"), (0.08,) * 3,
        bits=16,
    ),
    Attribute(
        "quats", "rotation", "quats", (4,),
        ("quat_w", "quat_x", "quat_y", "quat_z"), (), (),  # shape_xx to shape_yz have both rotation and scale
        held=True,
    ),
    Attribute(
        "scales", "scale", "log_scales", (3,),
        ("log_scale_0", "log_scale_1", "log_scale_2"),
        ("shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz"), (0.011,) * 3 + (0.008,) * 3,
        held=True, largest=MAX_LOG_SCALE,
    ),
    Attribute(
        "opacities", "opacity", "logit_opacities", (),
        ("opacity",), ("opacity",), (0.0096,),
        activate=_sigmoid, inverse=_logit,
    ),
    Attribute(
        "sh", "color", "sh", (-1, 3),
        ("sh_{k}_r", "sh_{k}_g", "sh_{k}_b"), ("sh_{k}_y", "sh_{k}_co", "sh_{k}_cg"), (0.0069, 0.0072, 0.0072),
        held=True, to_channels=to_ycocg, from_channels=from_ycocg,
    ),
)  # fmt: skip

BY_NAME: dict[str, Attribute] = {attribute.name: attribute for attribute in ATTRIBUTES}
NAMES: dict[str, dict[str, list[str]]] = {
    "motion": {one.name: list(one.channels) for one in ATTRIBUTES},
    "planes": {name: list(BY_NAME[name].components) for name in ("means", "sh", "opacities", "scales", "quats")},
}
"""Channels and components of each attribute, in the order of the manifest. Nothing else depends on this order."""

_BOUNDS = {name: (-MAX_VALUE, one.largest) for one in ATTRIBUTES for name in one.components}
_BOUNDS |= dict.fromkeys(BY_NAME["scales"].channels, (-MAX_SHAPE, MAX_SHAPE))


def value_bounds(name: str) -> tuple[float, float]:
    """The least and the largest value of a component or channel that can be rendered."""
    return _BOUNDS.get(name, (-MAX_VALUE, MAX_VALUE))


def components(sh_degree: int) -> tuple[tuple[str, Attribute], ...]:
    """Names of all components, such as mean_x, sh_0_r, opacity, log_scale_0 and quat_w, each with its attribute, in the
    order of the manifest. SH are coefficient-major."""
    return tuple((name, BY_NAME[attribute]) for attribute, names in _names("planes", sh_degree) for name in names)


def channels(sh_degree: int) -> tuple[str, ...]:
    """All channels of the profile `motion`, in the order of the manifest."""
    return tuple(name for _, names in _names("motion", sh_degree) for name in names)


def attribute_rows(profile: str, sh_degree: int) -> dict[str, slice]:
    """Rows of each attribute that has any among the channels (`motion`) or components (`planes`)."""
    rows, start = {}, 0
    for attribute, names in _names(profile, sh_degree):
        rows[attribute] = slice(start, start + len(names))
        start += len(names)
    return rows


def _names(profile: str, sh_degree: int) -> Iterator[tuple[str, list[str]]]:
    for attribute, names in NAMES[profile].items():
        if names:
            yield attribute, [name.format(k=k) for k in range(BY_NAME[attribute].repeats(sh_degree)) for name in names]
