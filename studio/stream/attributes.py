"""The table of what the stream stores of each splat: names, order, bits, steps.

The encoders, the decoders, the manifest and the training losses read it. In `planes`, each number of a splat is a
*component* with a range; in `motion`, each is a *channel* with a step. To add an attribute, add its row here, and its
values in `layout.component_frames` and `layout.ComponentArrays` (planes), and in `encode/motion.py`,
`decoders/motion.py` and `profiles/` (motion and losses).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

MAX_VALUE = 1e9
"""Largest magnitude of any value."""

MAX_LOG_SCALE = math.log(MAX_VALUE)

QpAttribute = Literal["means_low", "opacities", "scales", "quats", "sh"]
"""Attributes that can have a QP of their own; `means_low`: the low bytes of the means, or their residuals."""


@dataclass(frozen=True)
class Attribute:
    """One attribute of a splat.

    Attributes:
        name: means, quats, scales, opacities or sh.
        label: what people read.
        components: names in `planes`; {k} stands for each SH coefficient.
        channels: names in `motion`, likewise.
        steps: of the channels. An error of one step is about equally visible in every channel (found by rendering
            trained groups with one attribute coarsened at a time). For means, relative to the size of a typical splat.
        bits: of a component: 16, in two planes, or 8.
        held: whether `planes` keeps it at QP 22 where the QP is higher (paper, "Compression QP Setting").
        largest: the largest value that can be rendered.
    """

    name: str
    label: str
    components: tuple[str, ...]
    channels: tuple[str, ...]
    steps: tuple[float, ...]
    bits: int = 8
    held: bool = False
    largest: float = MAX_VALUE

    @property
    def qp_name(self) -> str:
        """Its name in `attribute_qps`."""
        return "means_low" if self.name == "means" else self.name


ATTRIBUTES = (
    Attribute(
        "means",
        "positions",
        ("mean_x", "mean_y", "mean_z"),
        ("residual_x", "residual_y", "residual_z"),
        (0.08,) * 3,
        bits=16,
    ),
    Attribute(
        "quats",
        "rotation",
        ("quat_w", "quat_x", "quat_y", "quat_z"),
        ("rotation_0", "rotation_1", "rotation_2"),
        (0.0015,) * 3,
        held=True,
    ),
    Attribute(
        "scales",
        "scale",
        ("log_scale_0", "log_scale_1", "log_scale_2"),
        ("log_scale_0", "log_scale_1", "log_scale_2"),
        (0.017,) * 3,
        held=True,
        largest=MAX_LOG_SCALE,
    ),
    Attribute("opacities", "opacity", ("opacity",), ("opacity",), (0.0096,)),
    Attribute(
        "sh",
        "color",
        ("sh_{k}_r", "sh_{k}_g", "sh_{k}_b"),
        ("sh_{k}_y", "sh_{k}_co", "sh_{k}_cg"),
        (0.0069, 0.0072, 0.0072),
        held=True,
    ),
)
"""In the order of the channels, and of the values that losses act on."""

BY_NAME = {attribute.name: attribute for attribute in ATTRIBUTES}
_COMPONENT_ORDER = ("means", "sh", "opacities", "scales", "quats")
_LARGEST = {name: one.largest for one in ATTRIBUTES for name in (*one.components, *one.channels)}


def largest(name: str) -> float:
    """The largest value of a component or channel that can be rendered."""
    return _LARGEST.get(name, MAX_VALUE)


@dataclass(frozen=True)
class Component:
    """One number per splat.

    Attributes:
        name: as in the manifest and in file names: mean_x, sh_0_r, opacity, log_scale_0, quat_w, ...
        attribute: that it belongs to.
    """

    name: str
    attribute: Attribute

    @property
    def bits(self) -> int:
        """16 or 8."""
        return self.attribute.bits

    @property
    def levels(self) -> int:
        """Largest code: 65535 or 255."""
        return (1 << self.bits) - 1


def components(sh_degree: int) -> tuple[Component, ...]:
    """All 11 + 3 (degree + 1)^2 components, in the order of the manifest. SH are coefficient-major."""
    found = (BY_NAME[name] for name in _COMPONENT_ORDER)
    return tuple(Component(name, one) for one in found for name in _names(one.components, sh_degree))


def channels(sh_degree: int) -> tuple[str, ...]:
    """All 10 + 3 (degree + 1)^2 channels of the profile `motion`, in the order of the manifest."""
    return tuple(name for one in ATTRIBUTES for name in _names(one.channels, sh_degree))


def component_rows(sh_degree: int) -> dict[str, slice]:
    """Rows of each attribute among the components."""
    return _rows((name, _names(BY_NAME[name].components, sh_degree)) for name in _COMPONENT_ORDER)


def channel_rows(sh_degree: int) -> dict[str, slice]:
    """Rows of each attribute among the channels."""
    return _rows((one.name, _names(one.channels, sh_degree)) for one in ATTRIBUTES)


def _names(names: tuple[str, ...], sh_degree: int) -> tuple[str, ...]:
    if "{k}" not in names[0]:
        return names
    return tuple(name.format(k=k) for k in range((sh_degree + 1) ** 2) for name in names)


def _rows(parts: Iterable[tuple[str, tuple[str, ...]]]) -> dict[str, slice]:
    found, start = {}, 0
    for attribute, names in parts:
        found[attribute] = slice(start, start + len(names))
        start += len(names)
    return found
