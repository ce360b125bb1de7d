"""The interface of the decoders of all profiles."""

from __future__ import annotations

from abc import ABC, abstractmethod

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.stream.manifest_models import GroupEntry


class DecodedFrame(ABC):
    """One frame, decoded but not dequantized."""

    @abstractmethod
    def gaussians(self) -> Gaussians:
        """The splats in the stream's order (Morton order of the keyframe), float32 on the CPU. Thread safe."""


class GroupDecoder(ABC):
    """Decodes the frames of one group in order.

    Attributes:
        group: its entry in the manifest.
        next_frame: index in the stream of the frame that `read` returns next.
    """

    def __init__(self, group: GroupEntry) -> None:
        self.group = group
        self.next_frame = group.first_frame

    def read(self) -> DecodedFrame:
        """The next frame; call `DecodedFrame.gaussians` on any thread for its splats.

        Raises:
            StudioError: a file is damaged, or the group has no further frame.
        """
        if self.next_frame >= self.group.end_frame:
            raise StudioError(
                "stream.end_of_group",
                f"group {self.group.index} has only {self.group.frame_count} frames",
                group=self.group.index,
            )
        frame = self._read(self.next_frame - self.group.first_frame)
        self.next_frame += 1
        return frame

    @abstractmethod
    def _read(self, index: int) -> DecodedFrame:
        """Frame `index` of the group, 0-based; called in order."""

    @abstractmethod
    def close(self) -> None:
        """Release decoders and memory."""
