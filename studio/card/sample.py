"""The few frames of footage that the checks look at: at its beginning, in its middle and at its end."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from v3studio.studio.calibration.epipolar import LONGEST
from v3studio.studio.calibration.outlines import Outlines, outline
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import Footage
from v3studio.studio.masks.filters import reduced, reduced_size
from v3studio.studio.masks.mask_files import FileMaskSource
from v3studio.studio.masks.mask_source import FullMaskSource, MissingMaskSource, masked_cameras
from v3studio.studio.progress import ProgressFn

_PIXELS, _FEWEST, _MOST = 180e6, 12, 24  # of all images that are read; frames at least and at most
_SMALL = 320  # pixels along the longer side of the images that are compared with others of their camera


@dataclass(eq=False)
class _Seen:
    """What was seen of a camera, in the order of the frames."""

    small: list[np.ndarray] = field(default_factory=list)
    masks: list[np.ndarray] = field(default_factory=list)
    hulls: list[np.ndarray] = field(default_factory=list)
    image: np.ndarray | None = None
    mask: np.ndarray | None = None


class Sample:
    """Images, masks and cameras of some frames. `see` takes all frames of a camera in order, those of different cameras
    in any order, also on several threads."""

    def __init__(self, footage: Footage) -> None:
        names = footage.camera_names
        pixels = sum(float(np.prod(footage.raw_size(name))) for name in names)
        self.frames, self.windows = _windows(footage.frames, int(np.clip(_PIXELS / pixels, _FEWEST, _MOST)))
        """The windows are the beginning, the middle and the end, in which frames follow each other."""
        self.runs = self.windows if len(self.frames) < len(footage.frames) else (slice(0, len(self.frames)),)
        self.shown = self.frames[len(self.frames) // 2] if self.frames else -1
        self._wanted, self._seen = frozenset(self.frames), {name: _Seen() for name in names}

    def see(self, camera: str, frame: int, image: np.ndarray, mask: np.ndarray | None) -> None:
        """Take in a frame, if it is one of the sample: (H, W, 3) uint8 RGB, and (H, W) uint8; None without a mask."""
        import cv2

        if frame not in self._wanted:
            return
        seen = self._seen[camera]
        size, image = reduced_size(image, _SMALL), reduced(image, LONGEST)
        small = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
        seen.small.append(small)
        if frame == self.shown:
            seen.image = image
        if mask is not None:
            mask = reduced(mask, LONGEST)
            seen.masks.append(cv2.resize(mask, size, interpolation=cv2.INTER_AREA))
            seen.hulls.append(outline(mask))
            if frame == self.shown:
                seen.mask = mask

    @cached_property
    def small(self) -> dict[str, np.ndarray]:
        """(frames, h, w) uint8 gray images by camera."""
        return {name: np.stack(seen.small) for name, seen in self._seen.items()}

    @cached_property
    def masks(self) -> dict[str, np.ndarray]:
        """(frames, h, w) uint8 masks as large as `small`, of the cameras that have all."""
        return {name: np.stack(seen.masks) for name, seen in self._masked()}

    @cached_property
    def images(self) -> dict[str, np.ndarray]:
        """(H, W, 3) uint8 RGB of the frame `shown` by camera, at most 960 pixels wide and high, as are its masks."""
        return {name: seen.image for name, seen in self._seen.items() if seen.image is not None}

    @property
    def shown_masks(self) -> dict[str, np.ndarray]:
        return {name: seen.mask for name, seen in self._masked() if seen.mask is not None}

    def outlines(self, every: bool = True) -> Outlines | None:
        """The outlines of at least two cameras' masks, in every frame or at the ends of the windows only; in pixels of
        `images`."""
        ends = sorted({end for window in self.windows for end in (window.start, window.stop - 1)})
        at = range(len(self.frames)) if every else ends
        hulls = {name: [seen.hulls[index] for index in at] for name, seen in self._masked()}
        return Outlines(hulls) if len(hulls) > 1 else None

    def _masked(self) -> Iterator[tuple[str, _Seen]]:
        return ((name, seen) for name, seen in self._seen.items() if len(seen.masks) == len(self.frames))


def read_sample(footage: Footage, progress: ProgressFn, computed: bool = True) -> Sample:
    """Read the frames, with masks where the footage has them, unless `computed` is false and they are not in files.
    Raises StudioError: an image cannot be read."""
    sample, source = Sample(footage), footage.mask_source
    masked = masked_cameras(source, footage.camera_names)
    if isinstance(source, FullMaskSource | MissingMaskSource) or not (computed or isinstance(source, FileMaskSource)):
        masked = ()
    for number, name in enumerate(footage.camera_names):
        for index, frame in enumerate(sample.frames):
            progress(number * len(sample.frames) + index, len(footage.camera_names) * len(sample.frames))
            image, mask = footage.image(name, frame), None
            if name in masked:
                with suppress(StudioError):  # the check of all files reports it
                    mask = footage.mask(name, frame)
            sample.see(name, frame, image, mask)
    return sample


def _windows(frames: tuple[int, ...], count: int) -> tuple[tuple[int, ...], tuple[slice, ...]]:
    """The frames to read, and which of them follow each other."""
    if len(frames) > count:
        length = count // 3
        starts = [0, (len(frames) - length) // 2, len(frames) - length]
        chosen = tuple(frame for start in starts for frame in frames[start : start + length])
    else:
        chosen, length = frames, max(1, -(-len(frames) // 3))
    return chosen, tuple(slice(start, min(start + length, len(chosen))) for start in range(0, len(chosen), length))
