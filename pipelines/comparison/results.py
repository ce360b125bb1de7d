"""comparison.json: quality of several takes by one protocol; and what an interrupted comparison has finished."""

import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np

from v3studio.pipelines.reports.images import write_image
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.files.json_files import Result, read_model, write_model
from v3studio.studio.atomic_files import remove
from v3studio.studio.errors import StudioError

RESULTS, FOLDER = "comparison.json", ".comparing"
"""Names of the results, and of the folder beside them with what an interrupted comparison has finished."""

Measures: TypeAlias = dict[str, float]
"""The metrics of a view of a decoded frame (`studio.comparison.METRICS`) by name, or their means over views."""


class FlickerOfFrame(Result):
    """Flicker between a frame and the one before it, mean over cameras."""

    frame: int
    flicker: float  # RMS change of the residual, in levels of 0 to 255
    group_border: bool  # whether a group begins with this frame


class ComparedTake(Result):
    """One take."""

    name: str
    folder: str
    measures: Measures  # means over cameras and frames
    cameras: dict[str, Measures]

    trained_on: tuple[str, ...] = ()
    """Measured cameras that this take was trained on; its figures are then no measure of new views."""

    flicker: float | None = None  # mean over frames; None without two consecutive frames
    flicker_at_group_borders: float | None = None
    flicker_by_frame: tuple[FlickerOfFrame, ...] = ()
    total_bytes: int  # all files that playing the best rendition takes, and the manifest, without the set
    stream_frames: int  # frames in the stream, also those that were not compared

    @property
    def bytes_per_frame(self) -> float:
        """`total_bytes` divided by the frames of the stream."""
        return self.total_bytes / self.stream_frames


class ComparisonProtocol(Result):
    """The way in which the takes were measured."""

    name: str
    title: str
    cameras: tuple[str, ...]
    resolution: dict[str, tuple[int, int]]  # width and height in pixels by camera name
    background: tuple[float, float, float]
    crop: str
    footage: str  # the take whose images and masks are compared with
    exact_masks: bool  # whether its masks are exact ones (evaluate.exact_masks)
    frames: tuple[int, ...]
    mean: str = "over the views of a frame, then over frames"
    lpips: str | None = None


class Comparison(Result):
    """Contents of comparison.json."""

    protocol: ComparisonProtocol
    takes: tuple[ComparedTake, ...]


class FrameOfTake(Result):
    """Figures of one take in one frame."""

    cameras: dict[str, Measures]  # by camera; without those that do not see the performer
    flicker: FlickerOfFrame | None = None


class ComparedFrame(Result):
    """Contents of one frame's file."""

    key: str  # digest of what the comparison is made from
    takes: tuple[FrameOfTake, ...]
    images: tuple[str, ...] = ()  # names of images beside the file


class FinishedFrames:
    """The finished frames of a comparison, on the disk, in a folder created with the first. `key`: digest of what it is
    made from; frames of others are deleted. `found`: frames that an interrupted one has finished, by number."""

    def __init__(self, out: Path, key: str) -> None:
        self._out = out
        self._folder = out / FOLDER
        self._key = key
        self.found: dict[int, ComparedFrame] = {}
        for path in self._folder.glob("*.json"):
            with suppress(StudioError):  # damaged
                frame = read_model(path, ComparedFrame)
                complete = all((self._folder / name).is_file() for name in frame.images)
                if frame.key == key and complete and path.stem.isdecimal():
                    self.found[int(path.stem)] = frame
        if not self.found:
            self.remove()

    def write(self, frame: int, takes: tuple[FrameOfTake, ...], images: Mapping[str, np.ndarray]) -> ComparedFrame:
        """Write one frame and its images, (H, W, 3) uint8 by file name. Raises StudioError: `take.*`, of the disk."""
        done = ComparedFrame(key=self._key, takes=takes, images=tuple(images))
        with disk_errors(self._out):
            self._folder.mkdir(exist_ok=True)
            for name, image in images.items():
                write_image(self._folder / name, image)
            write_model(self._folder / f"{frame:06d}.json", done)
        return done

    def publish(self, images: Iterable[str]) -> None:
        """Move images to the folder of the results."""
        for name in images:
            os.replace(self._folder / name, self._out / name)

    def remove(self) -> None:
        remove(self._folder)
