"""The interface between a profile and the training losses that act on what it codes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from torch import Tensor

from studio.gaussians import Gaussians
from studio.stream.attributes import ATTRIBUTES

CODED = tuple(attribute.name for attribute in ATTRIBUTES if attribute.name != "means")
"""Attributes that losses act on, in the order of their values."""

_TERMS = {"quats": "rotation", "scales": "scale", "opacities": "opacity", "sh": "color"}


def coded_columns(counts: Mapping[str, int], sh_degree: int) -> dict[str, slice]:
    """Columns of each term of the losses (paper, section 4.2), which count the first coefficient of SH as color.

    Args:
        counts: values per splat of each attribute in `CODED`; of SH, per coefficient.
        sh_degree: 0 to 3.
    """
    found, start = {}, 0
    for name in CODED:
        found[_TERMS[name]] = slice(start, start + counts[name])
        start += counts[name]
    if sh_degree > 0:
        found["sh"] = slice(start, start + counts["sh"] * ((sh_degree + 1) ** 2 - 1))
    return found


class SplatCoding(ABC):
    """What a profile codes of one frame's splats, given the previous frame of the same group.

    Means are left out: the losses that use this act on the other attributes only (paper, section 4.2).

    Attributes:
        profile: its name in the settings and the manifest.
        attributes: columns of each attribute in `values`.
        pixels: area of the picture that holds one channel, W x H of the paper's equation 12.

    Args:
        previous: N splats of the previous frame.
    """

    profile: ClassVar[str]
    attributes: Mapping[str, slice]
    pixels: int

    @abstractmethod
    def __init__(self, previous: Gaussians) -> None: ...

    @abstractmethod
    def coded_values(self, gaussians: Gaussians) -> Tensor:
        """(N, C) values that are quantized, differentiable; the splats must be in the order of the previous frame."""

    @abstractmethod
    def quantizer(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Offset and step of each channel, both (C,) and detached: coded is round((value - offset) / step).

        Args:
            values: (N, C) coded values of the frame that the range is measured on. The baker measures it over the
                whole group, which is not known during training.
        """

    @abstractmethod
    def decode(self, gaussians: Gaussians, values: Tensor) -> Gaussians:
        """The splats with means from `gaussians` and all else from (N, C) coded values; differentiable."""
