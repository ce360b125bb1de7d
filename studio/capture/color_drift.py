"""Automatic exposure and white balance: colors of the set that change during a take."""

from __future__ import annotations

import numpy as np

from studio.capture.frame_numbers import number_ranges
from studio.errors import Message

LARGEST = 0.03
"""Change of a color channel that is reported, relative to its median over time."""

_STEP = 4  # every fourth row and column is enough
_LEAST_PIXELS = 200
_DARK, _BRIGHT = 24, 232  # beyond, noise or clipping hides the gain; backgrounds that were cut out are 0 or 255


class ColorDrift:
    """Compares the set around the performer, frame by frame, with the first frame of each camera.

    The gain of a channel is the median over pixels, so that shadows and things that move do not count. `see` may be
    called by several threads with different cameras.
    """

    def __init__(self) -> None:
        self._first: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._gains: dict[str, dict[int, np.ndarray]] = {}

    def see(self, camera: str, frame: int, image: np.ndarray, mask: np.ndarray) -> None:
        """Measure a frame.

        Args:
            camera: its name.
            frame: number in the footage.
            image: (H, W, 3) uint8 RGB.
            mask: (H, W) uint8, 255 is the performer.
        """
        colors, around = image[::_STEP, ::_STEP].astype(np.float32), mask[::_STEP, ::_STEP] < 8
        if camera not in self._first:
            self._first[camera] = (colors, around)
            self._gains[camera] = {}
        first, first_around = self._first[camera]
        if colors.shape != first.shape:
            return
        usable = around & first_around
        for each in (colors, first):
            usable &= (each > _DARK).all(-1) & (each < _BRIGHT).all(-1)
        if usable.sum() >= _LEAST_PIXELS:
            self._gains[camera][frame] = np.median(colors[usable] / first[usable], axis=0)

    def messages(self) -> list[Message]:
        """A warning `footage.color_drift` for each camera whose colors change, with the fields `camera`, `frames` and
        `change` (largest change of a channel, 0.05 is 5%)."""
        found = []
        for camera, gains in sorted(self._gains.items()):
            if len(gains) < 3:
                continue
            frames, values = list(gains), np.stack(list(gains.values()))
            change = np.abs(values / np.median(values, axis=0) - 1)
            if change.max() <= LARGEST:
                continue
            far = [frame for frame, one in zip(frames, change.max(1), strict=True) if one > LARGEST]
            spread = change.max(0)
            together = np.ptp(values / np.median(values, axis=0), axis=1).max() < LARGEST
            what = "brightness" if together else "color"
            channel = ("red", "green", "blue")[int(spread.argmax())]
            amount = f"up to {100 * change.max():.0f}%" + ("" if together else f" in {channel}")
            found.append(
                Message(
                    "footage.color_drift",
                    f"Camera '{camera}': the {what} of the set changes by {amount} in frames {number_ranges(far)}",
                    fix="Film with manual exposure and white balance; splats would flicker with it.",
                    fields={"camera": camera, "frames": tuple(far), "change": round(float(change.max()), 4)},
                )
            )
        return found
