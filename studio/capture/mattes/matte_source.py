"""Where a capture's mattes come from: one small protocol, one class a source.

A `MatteSource` works on raw footage pixels; `Footage` undistorts and scales what it returns like the image. Any other
source needs nothing but this protocol to take part; for a matting function there is `FunctionMatteSource`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from studio.capture.frame_sources import FrameSource
from studio.capture.images import read_image
from studio.capture.mattes.clean_plate import DifferenceSettings, difference_matte
from studio.capture.mattes.median_background import Background, median_plate
from studio.capture.patterns import VIDEO_EXTENSIONS, Match
from studio.capture.per_camera_cache import PerCameraCache
from studio.errors import StudioError


class MatteSource(Protocol):
    """Gives foreground mattes of raw frames. Must be thread safe and give the same matte for the same frame."""

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """(H, W) uint8, 255 foreground, of the raw `image` (H, W, 3 or 4 with alpha) of a camera and frame."""
        ...

    def files(self) -> list[Path]:
        """The files that the mattes are made from, apart from the footage."""
        ...


@runtime_checkable
class Recolors(Protocol):
    """A `MatteSource` that also takes something off the performer's colors: a screen's light, say."""

    def recolored(self, camera: str, image: np.ndarray, matte: np.ndarray) -> np.ndarray:
        """(H, W, 3) uint8 to use for the raw `image` (H, W, 3) uint8, of which `matte` (H, W) is the matte."""
        ...


class FullMatteSource:
    """Everything is foreground."""

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`."""
        return np.full(image.shape[:2], 255, np.uint8)

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return []


class AlphaMatteSource:
    """The images' own alpha channel."""

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`."""
        if image.shape[2] != 4:
            raise StudioError(f"Frame {frame} of camera '{camera}' has no alpha channel to take the mask from.")
        return np.ascontiguousarray(image[:, :, 3])

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return []


class FileMatteSource:
    """Separate mask images or videos, one a camera and frame; white is foreground.

    A file's alpha channel is used where it has one and its colors say nothing (all equal). Masks of another size than
    the images are scaled where the aspect ratio is the same.
    """

    def __init__(self, sources: Mapping[str, FrameSource]) -> None:
        self._sources = dict(sources)

    def missing(self, camera: str, frames: tuple[int, ...]) -> list[int]:
        """Which of `frames` have no mask for `camera`."""
        source = self._sources.get(camera)
        have = set(source.frames) if source is not None else set()
        return [frame for frame in frames if frame not in have]

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`."""
        import cv2

        source = self._sources.get(camera)
        if source is None:
            raise StudioError(f"Camera '{camera}' has no mask file.")
        mask = source.read(frame)
        if mask.shape[2] == 4 and np.ptp(mask[:, :, :3]) == 0:
            matte = mask[:, :, 3]
        else:
            matte = mask[:, :, :3].max(axis=2)
        height, width = image.shape[:2]
        if matte.shape != (height, width):
            if abs(matte.shape[1] * height - matte.shape[0] * width) > max(height, width):
                raise StudioError(
                    f"The mask {source.where(frame)} is {matte.shape[1]}x{matte.shape[0]}, its image {width}x{height}: "
                    "they must have one aspect ratio."
                )
            shrink = matte.shape[1] > width
            how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
            matte = cv2.resize(np.ascontiguousarray(matte), (width, height), interpolation=how)
        return np.ascontiguousarray(matte)

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return [path for source in self._sources.values() for path in source.files()]


class PlateMatteSource:
    """Difference to the empty set, whose picture is loaded or estimated once a camera.

    Args:
        background: gives what is known of the set behind a camera's footage; called once each, then kept.
        files: what the plates are made from.
        settings: see `difference_matte`.
    """

    def __init__(
        self, background: Callable[[str], Background], files: list[Path], settings: DifferenceSettings | None = None
    ) -> None:
        self._files = files
        self._settings = settings or DifferenceSettings()
        self._backgrounds = PerCameraCache(background)

    def background(self, camera: str) -> Background:
        """The empty set as `camera` sees it, in raw pixels."""
        return self._backgrounds(camera)

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`."""
        behind = self.background(camera)
        if behind.plate.shape[:2] != image.shape[:2]:
            raise StudioError(
                f"The clean plate of camera '{camera}' is {behind.plate.shape[1]}x{behind.plate.shape[0]}, its footage "
                f"{image.shape[1]}x{image.shape[0]}; they must have one size."
            )
        image = np.ascontiguousarray(image[:, :, :3])
        return difference_matte(image, behind.plate, self._settings, behind.known, behind.doubtful, behind.colors)

    def plate(self, camera: str) -> np.ndarray | None:
        """(H, W, 3) uint8 raw picture of the empty set where all of it can be believed, else None."""
        behind = self.background(camera)
        return behind.plate if behind.known is None and behind.doubtful is None else None

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return list(self._files)


def plates_from_files(matches: list[Match], color_matrix: str) -> Callable[[str], Background]:
    """A loader of clean plates from images, several images a camera or videos (of which the median is taken)."""
    groups: dict[str, list[Match]] = {}
    for match in matches:
        groups.setdefault(match.camera, []).append(match)

    def load(camera: str) -> Background:
        from studio.capture.video import VideoReader

        if camera not in groups:
            raise StudioError(f"Camera '{camera}' has no clean plate; it has {', '.join(sorted(groups)) or 'none'}.")
        paths = [match.path for match in groups[camera]]
        if paths[0].suffix.lower() in VIDEO_EXTENSIONS:
            reader = VideoReader(paths[0], color_matrix)
            try:
                return Background(median_plate(lambda frame: reader.read(frame)[:, :, :3], reader.frame_count))
            finally:
                reader.close()
        if len(paths) == 1:
            return Background(np.ascontiguousarray(read_image(paths[0])[:, :, :3]))
        return Background(median_plate(lambda index: read_image(paths[index])[:, :, :3], len(paths)))

    return load
