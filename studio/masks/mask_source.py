"""The `MaskSource` protocol, what a source is opened with, and the sources that need no file of their own.

A `MaskSource` works on raw footage pixels; `Footage` undistorts and scales its masks like the images. New sources
only have to implement this protocol; `FunctionMaskSource` implements it for any matting function. Sources that settings
can choose are listed in `studio.masks.sources`.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.capture.frame_sources import DecoderPool, FrameSource
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.errors import Message, StudioError

Item = TypeVar("Item")

FEWEST_VOTERS = 3
"""Fewer cameras for training cannot outvote one."""


@runtime_checkable
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

    def files(self) -> list[Path]:
        """The files that the masks depend on, excluding the footage."""
        return []


@runtime_checkable
class Recolors(Protocol):
    """A `MaskSource` that also corrects colors, for example by despill."""

    def recolored(self, camera: str, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The corrected (H, W, 3) uint8 RGB of a raw `image` (H, W, 3) uint8 with the `mask` (H, W) uint8."""


@runtime_checkable
class ShowsSet(Protocol):
    """A `MaskSource` that knows the empty set."""

    def plate(self, camera: str) -> np.ndarray | None:
        """(H, W, 3) uint8 raw image of the empty set; (H, W, 4) with 0 instead of 255 where it is not reliable. None
        if it is not known."""


@runtime_checkable
class OfSomeCameras(Protocol):
    """A `MaskSource` that may lack masks of some cameras. Those are not used, or if held out, not measured."""

    @property
    def cameras(self) -> Collection[str] | None:
        """Names of the cameras with masks, which may include unused ones; None: all."""


def evenly_spaced(items: Sequence[Item], count: int) -> list[Item]:
    """Up to `count` of the items, with the first and the last."""
    places = range(len(items)) if len(items) <= count else np.linspace(0, len(items) - 1, count)
    return [items[round(place)] for place in places]


def masked_cameras(source: MaskSource, names: Sequence[str]) -> tuple[str, ...]:
    """Cameras among `names` that have masks of a source."""
    masked = source.cameras if isinstance(source, OfSomeCameras) else None
    return tuple(name for name in names if masked is None or name in masked)


@dataclass(frozen=True)
class GarbageMasks:
    """Areas in which the performer may be; `studio.masks.garbage_masks` reads them.

    Attributes:
        inside: for camera, frame and raw image (H, W, ...): (H, W) bool; None: everywhere. Raises StudioError.
        files: from which they are read.
    """

    inside: Callable[[str, int, np.ndarray], np.ndarray | None]
    files: list[Path]


@dataclass(frozen=True)
class MaskInputs:
    """The inputs with which a source of masks is opened."""

    spec: CaptureSettings
    sources: Mapping[str, FrameSource]  # frames of each camera
    frames: tuple[int, ...]  # frame numbers that must have a mask file
    held_out: tuple[str, ...]  # cameras that need none
    pool: DecoderPool  # bounds the number of open decoders
    cache_folder: Path | None = None  # for estimated backgrounds and masks of a model; None caches in memory only
    device: str = "auto"  # device, threads: device and CPU threads of a matting model, as in `MattingModel`
    threads: int = 0
    garbage: GarbageMasks | None = None  # for sources that profit from knowing it; `Footage` applies it in any case
    cameras: Callable[[], Mapping[str, Camera]] | None = None  # of the raw frames, by name; None before calibration

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras."""
        return tuple(self.sources)

    @property
    def voters(self) -> frozenset[str]:
        """The cameras for training, whose masks can be compared."""
        return frozenset(self.names) - frozenset(self.held_out)

    @property
    def can_vote(self) -> bool:
        """Whether the cameras are calibrated, and enough to compare their masks."""
        return self.cameras is not None and len(self.voters) >= FEWEST_VOTERS

    @property
    def frame_count(self) -> int:
        """Frames of the camera that has the fewest."""
        return min(len(source.frames) for source in self.sources.values())

    def image(self, camera: str, frame: int) -> np.ndarray:
        """(H, W, 3) uint8 raw image. Raises StudioError if it cannot be read."""
        return self.sources[camera].read(frame)[:, :, :3]

    def inside(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray | None:
        """Area in which the performer may be, (H, W) bool; None: everywhere. Raises StudioError."""
        return None if self.garbage is None else self.garbage.inside(camera, frame, image)

    def first_image(self, camera: str) -> np.ndarray:
        """(H, W, 3) uint8 raw image of the camera's first frame. Raises StudioError if it cannot be read."""
        return self.image(camera, self.sources[camera].frames[0])


class FullMaskSource(MaskSource):
    """A `MaskSource` for which everything is foreground."""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        return np.full(image.shape[:2], 255, np.uint8)


def open_none(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str]:
    """Open a source without masks, for `SOURCES`."""
    return FullMaskSource(), "none; everything is foreground"


class MissingMaskSource(MaskSource):
    """A `MaskSource` where none was found: what needs masks stops there, with the `reasons`, clauses."""

    def __init__(self, reasons: str) -> None:
        problem = f"capture.masks is auto, but the capture has no masks that could be used: {reasons}"
        fix = (
            "Add masks or clean plates, or set capture.masks: to chroma_key before a colored screen, to model, or to "
            "none if the images show nothing but the performer."
        )
        self.message = Message("mask.no_source", problem, fix=fix, fields={"setting": "capture.masks"})

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError `mask.no_source`."""
        raise StudioError.of(self.message)
