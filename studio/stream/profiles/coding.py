"""The interface between a profile and the training losses that act on what it codes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from torch import Tensor

from studio.gaussians import Gaussians


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
