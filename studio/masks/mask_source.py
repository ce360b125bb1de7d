"""The `MaskSource` protocol and its basic implementations.

A `MaskSource` works on raw footage pixels; `Footage` undistorts and scales its masks like the images. New sources
only have to implement this protocol; `FunctionMaskSource` implements it for any matting function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from studio.capture.frame_sources import FrameSource
from studio.capture.images import read_image
from studio.capture.patterns import VIDEO_EXTENSIONS, Match
from studio.capture.settings import DifferenceSettings
from studio.capture.transfer import TransferFunction
from studio.errors import Message, StudioError
from studio.masks.clean_plate import difference_mask
from studio.masks.median_background import Background, median_plate
from studio.memory_cache import MemoryCache

_MOST_LABELS = 24  # more than any labeling of body parts, and invisible as a mask


class MaskSource(Protocol):
    """Computes masks of raw frames. Must be thread safe and deterministic."""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask of one frame.

        Args:
            camera: the camera's name.
            frame: the frame number.
            image: (H, W, 3) RGB or (H, W, 4) RGBA uint8 raw image.

        Returns:
            (H, W) uint8, 255 = foreground.

        Raises:
            StudioError: no mask can be computed.
        """
        ...

    def files(self) -> list[Path]:
        """The files that the masks depend on, excluding the footage."""
        ...


@runtime_checkable
class Recolors(Protocol):
    """A `MaskSource` that also corrects colors, for example by despill."""

    def recolored(self, camera: str, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The corrected (H, W, 3) uint8 RGB of a raw `image` (H, W, 3) uint8 with the `mask` (H, W) uint8."""
        ...


class GarbageMasks(Protocol):
    """Where the performer may be, see `studio.masks.garbage_masks`."""

    def inside(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray | None:
        """(H, W) bool, where the performer may be in the raw `image` (H, W, ...); None: everywhere."""
        ...

    def files(self) -> list[Path]:
        """The files from which they are read."""
        ...


class FullMaskSource:
    """A `MaskSource` for which everything is foreground."""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`."""
        return np.full(image.shape[:2], 255, np.uint8)

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return []


class MissingMaskSource:
    """A `MaskSource` for captures in which no source of masks was found: what needs masks stops there.

    Args:
        reasons: what is missing, as a clause.
    """

    def __init__(self, reasons: str) -> None:
        self.message = Message(
            "mask.no_source",
            f"capture.masks is auto, but the capture has no masks that could be used: {reasons}",
            fix="Set capture.masks to chroma_key, plain or model, add masks or clean plates, or set it to none if the "
            "pictures show nothing but the performer.",
            fields={"setting": "capture.masks"},
        )

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`. Raises StudioError `mask.no_source`."""
        raise StudioError(self.message.code, self.message.problem, fix=self.message.fix, **self.message.fields)

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return []


class AlphaMaskSource:
    """A `MaskSource` that uses the alpha channel of the images."""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`. Raises StudioError `mask.alpha_missing`."""
        if image.shape[2] != 4:
            raise StudioError(
                "mask.alpha_missing",
                f"Frame {frame} of camera '{camera}' has no alpha channel",
                fix="Choose another source of masks in capture.masks.",
                camera=camera,
                frame=frame,
                setting="capture.masks",
            )
        return np.ascontiguousarray(image[:, :, 3])

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return []


class FileMaskSource:
    """A `MaskSource` that reads mask images, one per camera and frame, or mask videos; white is foreground.

    In a PNG file whose values are all small, they are labels: 0 is the background, any other the performer.
    If a file has an alpha channel and all its pixels have the same color, the alpha channel is used. Masks that differ
    in size from the images are resized if the aspect ratio is the same.

    Args:
        sources: camera name to its masks.
    """

    def __init__(self, sources: Mapping[str, FrameSource]) -> None:
        self._sources = dict(sources)

    def missing(self, camera: str, frames: tuple[int, ...]) -> list[int]:
        """Those of `frames` for which `camera` has no mask."""
        source = self._sources.get(camera)
        have = set(source.frames) if source is not None else set()
        return [frame for frame in frames if frame not in have]

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`.

        Raises:
            StudioError: `mask.missing`, `mask.aspect_ratio`, or the file cannot be read.
        """
        import cv2

        source = self._sources.get(camera)
        if source is None:
            raise StudioError(
                "mask.missing", f"Camera '{camera}' has no mask files", camera=camera, frames=(frame,), kind="mask"
            )
        stored = source.read(frame)
        if stored.shape[2] == 4 and np.ptp(stored[:, :, :3]) == 0:
            mask = stored[:, :, 3]
        else:
            mask = stored[:, :, :3].max(axis=2)
            # labels of body parts instead of white, as in ZJU-MoCap
            if 0 < mask.max() <= _MOST_LABELS and all(path.suffix == ".png" for path in source.files([frame])):
                mask = np.where(mask > 0, 255, 0).astype(np.uint8)
        height, width = image.shape[:2]
        if mask.shape != (height, width):
            if abs(mask.shape[1] * height - mask.shape[0] * width) > max(height, width):
                files = source.files([frame])
                raise StudioError(
                    "mask.aspect_ratio",
                    f"the mask of frame {frame} is {mask.shape[1]}x{mask.shape[0]}, its image {width}x{height}",
                    file=files[0] if files else None,
                    value=(mask.shape[1], mask.shape[0]),
                    fix="Masks must have the aspect ratio of the images.",
                    camera=camera,
                    frame=frame,
                    expected=(width, height),
                )
            shrink = mask.shape[1] > width
            how = cv2.INTER_AREA if shrink else cv2.INTER_LINEAR
            mask = cv2.resize(np.ascontiguousarray(mask), (width, height), interpolation=how)
        return np.ascontiguousarray(mask)

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return [path for source in self._sources.values() for path in source.files()]


class PlateMaskSource:
    """A `MaskSource` from the difference to the empty set, whose image is loaded or estimated once per camera.

    Args:
        background: loads or estimates the background of a camera; called once per camera.
        files: files that the backgrounds depend on.
        settings: see `difference_mask`.
        garbage: where the performer may be; None: everywhere.
    """

    def __init__(
        self,
        background: Callable[[str], Background],
        files: list[Path],
        settings: DifferenceSettings | None = None,
        garbage: GarbageMasks | None = None,
    ) -> None:
        self._files = files
        self._garbage = garbage
        self._settings = settings or DifferenceSettings()
        self._load = background
        self._backgrounds: MemoryCache[str, Background] = MemoryCache(math.inf)

    def background(self, camera: str) -> Background:
        """The background of `camera`, in raw pixels."""
        return self._backgrounds.get_or_make(camera, self._load)

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`. Raises StudioError `mask.plate_size`, or the plate cannot be loaded."""
        behind = self.background(camera)
        if behind.plate.shape[:2] != image.shape[:2]:
            size, expected = (behind.plate.shape[1], behind.plate.shape[0]), (image.shape[1], image.shape[0])
            raise StudioError(
                "mask.plate_size",
                f"The clean plate of camera '{camera}' is {size[0]}x{size[1]}, its footage {expected[0]}x{expected[1]}",
                value=size,
                fix="Clean plates must have the size of the footage.",
                camera=camera,
                expected=expected,
            )
        image = np.ascontiguousarray(image[:, :, :3])
        inside = self._garbage.inside(camera, frame, image) if self._garbage is not None else None
        if inside is not None:  # here, so that garbage does not count as a component
            image = np.where(inside[:, :, None], image, behind.plate)
        return difference_mask(image, behind.plate, self._settings, behind.known, behind.doubtful, behind.colors)

    def plate(self, camera: str) -> np.ndarray | None:
        """(H, W, 3) uint8 raw image of the empty set if all of it is reliable, else None."""
        behind = self.background(camera)
        return behind.plate if behind.known is None and behind.doubtful is None else None

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return list(self._files)


def plates_from_files(
    matches: list[Match], color_matrix: str, transfer: TransferFunction = "auto"
) -> Callable[[str], Background]:
    """A loader of clean plates: one image per camera, or the median of several images or of a video.

    Args:
        matches: files of the clean plates.
        color_matrix: for videos, see `VideoReader`.
        transfer: what the values in the files are, as in `CaptureSettings`.

    Returns:
        a function from a camera's name to its background. It raises StudioError `mask.plate_missing` for a camera
        without a plate, or if the file cannot be read.
    """
    groups: dict[str, list[Match]] = {}
    for match in matches:
        groups.setdefault(match.camera, []).append(match)

    def load(camera: str) -> Background:
        from studio.capture.video import VideoReader

        if camera not in groups:
            raise StudioError(
                "mask.plate_missing",
                f"Camera '{camera}' has no clean plate; cameras with one: {', '.join(sorted(groups)) or 'none'}",
                camera=camera,
                setting="capture.clean_plates",
            )
        paths = [match.path for match in groups[camera]]
        if paths[0].suffix.lower() in VIDEO_EXTENSIONS:
            reader = VideoReader(paths[0], color_matrix, transfer)
            try:
                return Background(median_plate(lambda frame: reader.read(frame)[:, :, :3], reader.frame_count))
            finally:
                reader.close()
        if len(paths) == 1:
            return Background(np.ascontiguousarray(read_image(paths[0], transfer)[:, :, :3]))
        return Background(median_plate(lambda index: read_image(paths[index], transfer)[:, :, :3], len(paths)))

    return load
