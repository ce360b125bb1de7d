"""What every profile's decoder offers."""

from __future__ import annotations

from abc import ABC, abstractmethod

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.manifest_models import GroupEntry


class DecodedFrame(ABC):
    """One frame as its group's files have it, decoded and not yet dequantized."""

    @abstractmethod
    def gaussians(self) -> Gaussians:
        """The splats in the stream's order (Morton order of the keyframe), float32 on the CPU. Thread safe."""


class GroupDecoder(ABC):
    """Decodes one group's frames in order.

    Attributes:
        group: its entry in the manifest.
        next_frame: index in the stream of the frame that `read` gives next.
    """

    def __init__(self, group: GroupEntry) -> None:
        self.group = group
        self.next_frame = group.first_frame

    def read(self) -> DecodedFrame:
        """The next frame; `DecodedFrame.gaussians` makes splats of it, on any thread.

        Raises:
            StudioError: a file is damaged, or there is no further frame in the group.
        """
        if self.next_frame >= self.group.end_frame:
            raise StudioError(
                f"Group {self.group.index} has {self.group.frame_count} frames; there is none after them."
            )
        frame = self._read(self.next_frame - self.group.first_frame)
        self.next_frame += 1
        return frame

    @abstractmethod
    def _read(self, index: int) -> DecodedFrame:
        """Frame `index` of the group, 0-based; called in order."""

    @abstractmethod
    def close(self) -> None:
        """Free what it holds."""
