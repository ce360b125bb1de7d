"""Whether masks are those of their images: measured where images and masks change from frame to frame."""

from collections.abc import Sequence

import numpy as np

SHIFTS = (-2, -1, 0, 1, 2)
_LEAST = 30  # pixels in which masks change that are enough, of a camera's reduced images
_CHANGED = 24  # gray levels by which a pixel changes if something moved there, and noise does not
_MARGIN = 5  # pixels around masks, reduced, in which shadows and ragged edges are tolerated
_LEAST_CHANGED = 60  # changed pixels in all images of a camera that are enough


def shift_scores(images: np.ndarray, masks: np.ndarray, windows: Sequence[slice]) -> np.ndarray | None:
    """(5,) how much images (N, h, w) change, in gray levels, where masks of 2 and 1 frames before, the same and 1 and 2
    frames after appear or vanish; None if they hardly do."""
    sums, counts = np.zeros(len(SHIFTS)), np.zeros(len(SHIFTS))
    for window in windows:
        gray, inside = images[window].astype(np.int16), masks[window] > 127
        if len(gray) < len(SHIFTS) + 1:
            continue
        changes = np.abs(np.diff(gray, axis=0))
        crossed = inside[1:] != inside[:-1]
        span = range(2, len(changes) - 2)
        for place, shift in enumerate(SHIFTS):
            for index in span:
                where = crossed[index + shift]
                counts[place] += where.sum()
                sums[place] += changes[index][where].sum()
    return None if counts.min() < _LEAST else sums / counts


def uncovered(images: np.ndarray, masks: np.ndarray, windows: Sequence[slice]) -> tuple[int, int]:
    """Pixels that change clearly between the ends of the windows, and those of them that are far outside of the masks
    of both frames."""
    import cv2

    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _MARGIN + 1, 2 * _MARGIN + 1))
    ends = sorted({end for window in windows for end in (window.start, window.stop - 1)})
    wide = [cv2.dilate((masks[end] > 127).astype(np.uint8), disk) for end in ends]
    changed = outside = 0
    for first in range(len(ends)):
        for second in range(first + 1, len(ends)):
            moved = np.abs(images[ends[first]].astype(np.int16) - images[ends[second]]) > _CHANGED
            moved &= cv2.blur(moved.astype(np.float32), (3, 3)) > 0.5
            changed += int(moved.sum())
            outside += int((moved & (wide[first] == 0) & (wide[second] == 0)).sum())
    return (changed, outside) if changed >= _LEAST_CHANGED else (0, 0)
