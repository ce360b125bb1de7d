"""The few frames of footage that the checks look at: at its beginning, in its middle and at its end."""

from dataclasses import dataclass, field

import numpy as np

from v3studio.studio.calibration.outlines import Outlines, outline
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import Footage
from v3studio.studio.masks.mask_source import FullMaskSource, MissingMaskSource, masked_cameras
from v3studio.studio.progress import ProgressFn

_PIXELS, _FEWEST, _MOST = 180e6, 12, 24  # of all images that are read; frames at least and at most
_SMALL = 320  # pixels along the longer side of the images that are compared with others of their camera


@dataclass(eq=False)
class Sample:
    """Images, masks and cameras that were read. By camera, in the order of `frames`: `small`, (frames, h, w) uint8 gray
    images; `masks`, the same of masks; `hulls`, see `Outlines`. `images`: (H, W, 3) uint8 RGB of the frame `shown`, and
    `shown_masks`, (H, W) uint8."""

    frames: tuple[int, ...]
    windows: tuple[slice, ...]  # the beginning, the middle and the end, in which frames follow each other
    runs: tuple[slice, ...]  # all frames that follow each other: the windows, or all of them
    shown: int
    small: dict[str, np.ndarray] = field(default_factory=dict)
    masks: dict[str, np.ndarray] = field(default_factory=dict)
    hulls: dict[str, list[np.ndarray]] = field(default_factory=dict)
    images: dict[str, np.ndarray] = field(default_factory=dict)
    shown_masks: dict[str, np.ndarray] = field(default_factory=dict)

    def outlines(self, every: bool = True) -> Outlines | None:
        """The outlines of at least two cameras' masks, in every frame or at the ends of the windows only."""
        ends = sorted({end for window in self.windows for end in (window.start, window.stop - 1)})
        at = range(len(self.frames)) if every else ends
        hulls = {name: [own[index] for index in at] for name, own in self.hulls.items()}
        return Outlines(hulls) if len(hulls) > 1 else None


def read_sample(footage: Footage, progress: ProgressFn) -> Sample:
    """Read the frames, with masks where the footage has them. Raises StudioError: an image cannot be read."""
    import cv2

    names = footage.camera_names
    pixels = sum(float(np.prod(footage.raw_size(name))) for name in names)
    count = int(np.clip(_PIXELS / pixels, _FEWEST, _MOST))
    frames, windows = _windows(footage.frames, count)
    runs = windows if len(frames) < len(footage.frames) else (slice(0, len(frames)),)
    sample = Sample(frames, windows, runs, len(frames) // 2)
    source = footage.mask_source
    masked = () if isinstance(source, FullMaskSource | MissingMaskSource) else masked_cameras(source, names)
    for number, name in enumerate(names):
        small, masks, outlines = [], [], []
        for index, frame in enumerate(frames):
            progress(number * len(frames) + index, len(names) * len(frames))
            image = footage.image(name, frame)
            factor = min(1.0, _SMALL / max(image.shape[:2]))
            size = (max(1, round(factor * image.shape[1])), max(1, round(factor * image.shape[0])))
            small.append(cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA))
            if index == sample.shown:
                sample.images[name] = image
            if name not in masked:
                continue
            try:
                mask = footage.mask(name, frame)
            except StudioError:  # the check of all files reports it
                masked = tuple(other for other in masked if other != name)
                continue
            masks.append(cv2.resize(mask, size, interpolation=cv2.INTER_AREA))
            outlines.append(outline(mask))
            if index == sample.shown:
                sample.shown_masks[name] = mask
        sample.small[name] = np.stack(small)
        if name in masked:
            sample.masks[name], sample.hulls[name] = np.stack(masks), outlines
    return sample


def _windows(frames: tuple[int, ...], count: int) -> tuple[tuple[int, ...], tuple[slice, ...]]:
    """The frames to read, and which of them follow each other."""
    if len(frames) > count:
        length = count // 3
        starts = [0, (len(frames) - length) // 2, len(frames) - length]
        chosen = tuple(frame for start in starts for frame in frames[start : start + length])
    else:
        chosen, length = frames, -(-len(frames) // 3)
    return chosen, tuple(slice(start, min(start + length, len(chosen))) for start in range(0, len(chosen), length))
