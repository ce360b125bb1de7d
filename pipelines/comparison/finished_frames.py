"""What a comparison that was interrupted has finished: one file per frame, until the comparison is complete."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from pipelines.comparison.results import FlickerOfFrame, Measures
from pipelines.reports.pictures import write_picture
from pipelines.takes.atomic_files import Result, disk_errors, read_model, remove, write_model
from studio.errors import StudioError

FOLDER = ".comparing"
"""Name of the folder in that of the results."""


class FrameOfTake(Result):
    """What was measured of one take in one frame."""

    cameras: dict[str, Measures]
    """By camera; without those that do not see the performer."""

    flicker: FlickerOfFrame | None = None


class ComparedFrame(Result):
    """Contents of one frame's file."""

    key: str
    """Digest of what the comparison is made from."""

    takes: tuple[FrameOfTake, ...]
    pictures: tuple[str, ...] = ()
    """Names of pictures beside the file."""


class FinishedFrames:
    """The finished frames of a comparison, on the disk. The folder is created with the first frame.

    Args:
        out: folder of the results.
        key: digest of what the comparison is made from; frames of other comparisons are deleted.

    Attributes:
        found: frames that an interrupted comparison has finished, by frame number.
    """

    def __init__(self, out: Path, key: str) -> None:
        self._out = out
        self._folder = out / FOLDER
        self._key = key
        self.found: dict[int, ComparedFrame] = {}
        for path in self._folder.glob("*.json"):
            frame = self._read(path)
            if frame is not None and path.stem.isdecimal():
                self.found[int(path.stem)] = frame
        if not self.found:
            self.remove()

    def write(self, frame: int, takes: tuple[FrameOfTake, ...], pictures: Mapping[str, np.ndarray]) -> ComparedFrame:
        """Write one frame and its pictures, (H, W, 3) uint8 by file name.

        Raises:
            StudioError: the disk is full or cannot be written (`take.disk_full`, `take.not_writable`).
        """
        done = ComparedFrame(key=self._key, takes=takes, pictures=tuple(pictures))
        with disk_errors(self._out):
            self._folder.mkdir(exist_ok=True)
            for name, picture in pictures.items():
                write_picture(self._folder / name, picture)
            write_model(self._folder / f"{frame:06d}.json", done)
        return done

    def publish(self, pictures: Iterable[str]) -> None:
        """Move pictures to the folder of the results."""
        for name in pictures:
            os.replace(self._folder / name, self._out / name)

    def remove(self) -> None:
        """Delete the folder and all in it."""
        remove(self._folder)

    def _read(self, path: Path) -> ComparedFrame | None:
        """None if it is of another comparison, or damaged."""
        try:
            frame = read_model(path, ComparedFrame)
        except StudioError:
            return None
        complete = all((self._folder / name).is_file() for name in frame.pictures)
        return frame if frame.key == self._key and complete else None
