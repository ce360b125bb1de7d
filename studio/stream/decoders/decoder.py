"""The interface of the decoders of all profiles."""

import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.stream.manifest import PlaneEntry, Rendition, VideoEntry


@dataclass(frozen=True, eq=False)
class DecodedFrame:
    """One frame, decoded but not dequantized: what its video shows, (height, width) uint8, or one such image for each
    of several videos, in the order of the manifest; and what makes splats of it."""

    picture: np.ndarray
    convert: Callable[[np.ndarray], Gaussians]

    def gaussians(self) -> Gaussians:
        """The splats in the stream's order (Morton order of the keyframe), float32 on the CPU. Thread safe."""
        return self.convert(self.picture)


class GroupDecoder(ABC):
    """Decodes the frames of one group in order; `next_frame`: index in the stream of the one that `read` returns."""

    def __init__(self, group: Rendition) -> None:
        self.group = group
        self.next_frame = group.first_frame

    def read(self) -> DecodedFrame:
        """The next frame; call `DecodedFrame.gaussians` on any thread for its splats. StudioError if a file is damaged,
        or there is none."""
        if self.next_frame >= self.group.end_frame:
            problem = f"group {self.group.index} has only {self.group.frame_count} frames"
            raise StudioError("stream.end_of_group", problem, group=self.group.index)
        frame = self._read(self.next_frame - self.group.first_frame)
        self.next_frame += 1
        return frame

    @abstractmethod
    def _read(self, index: int) -> DecodedFrame:
        """Frame `index` of the group, 0-based; called in order."""

    @abstractmethod
    def close(self) -> None:
        """Release decoders and memory."""


def check_luma(video: VideoEntry | PlaneEntry, index: int, luma: np.ndarray, name: str) -> None:
    """Compare image `index` (0-based) of a video, contiguous uint8 luma, with its check, if it has one."""
    for check in video.checks:
        if check.picture == index and (crc32 := zlib.crc32(luma.data)) != check.crc32:
            raise StudioError(
                "stream.wrong_luma",
                f"picture {index} decodes to other values than the manifest says: the decoder is not exact, or the "
                "manifest is wrong",
                file=f"{name}/{video.path}",
                value=crc32,
                fix="Bake the stream again; if that does not help, install PyAV from PyPI.",
                expected=check.crc32,
                picture=index,
            )
