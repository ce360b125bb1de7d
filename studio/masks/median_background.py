"""The empty set, estimated from footage in which a performer moves.

A temporal median fails if the performer covers a pixel half of the time. Instead, for each camera and at reduced size:

1. The background of a pixel is the mode of its color over time: static parts have one exact color, while moving parts
   do not, even if they are visible more often.
2. Differences from clear modes give the colors of the performer, the other pixels those of the set. For each pixel, the
   mode that looks most like the set is chosen, and the colors are learned again.
3. Masks are computed with the result, and the modes are computed again from the frames in which a pixel is uncovered.

If a pixel is always covered, its background is marked as unknown.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from v3studio.studio.atomic_files import atomic_path
from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.masks.clean_plate import Background, difference_evidence
from v3studio.studio.masks.filters import (
    color_bins,
    color_table,
    guided_filter,
    largest_channel,
    odds_of_colors,
    reduced,
)
from v3studio.studio.masks.mask_source import evenly_spaced
from v3studio.studio.memory import is_out_of_memory
from v3studio.studio.memory_cache import MemoryCache

_SIDE = 480  # longest side while estimating
_SAMPLES = 40  # most frames that are looked at
_BINS = 24  # of colors, per channel
_SLOTS = 7  # full-size samples per pixel for the median
_KEPT_BYTES = 2 << 30
_VERSION = 1  # of the algorithm; part of the names of cached files


def background_cache() -> MemoryCache[str, Background]:
    """A cache of backgrounds by camera. It keeps the last ones used, since a large rig's do not fit into memory
    together."""
    return MemoryCache(_KEPT_BYTES, lambda behind: behind.nbytes, least=1)


def median_plate(images: Callable[[int], np.ndarray], count: int) -> np.ndarray:
    """Per-pixel median of (H, W, 3) uint8 images of an empty set, of at most 15, evenly spaced."""
    stack = np.stack([images(index) for index in evenly_spaced(range(count), 15)])
    plate = np.empty(stack.shape[1:], np.uint8)
    for top in range(0, stack.shape[1], 64):  # in strips: np.median makes a float copy
        plate[top : top + 64] = np.rint(np.median(stack[:, top : top + 64], axis=0)).astype(np.uint8)
    return plate


def estimate_background(read: Callable[[int], np.ndarray], frames: Sequence[int]) -> Background:
    """Estimate the empty set from one camera's footage by the steps at the top of this file. Each sampled frame is read
    twice, in order."""
    import cv2

    chosen, small = evenly_spaced(frames, _SAMPLES), []
    for frame in chosen:
        image = read(frame)
        small.append(reduced(image, _SIDE))
    stack = np.stack(small)
    plate, members, known, doubtful, colors = _estimate_small(stack)
    height, width = image.shape[:2]
    full = cv2.resize(np.rint(plate).astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR)
    full = _full_plate(read, chosen, members, full)
    known = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0

    def enlarged(area: np.ndarray) -> np.ndarray:
        return cv2.resize(area.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0

    return Background(full, enlarged(known), enlarged(doubtful), colors)


def _tolerance(stack: np.ndarray) -> int:
    """Largest difference between samples of a static pixel, in levels: 4 plus three times the noise."""
    steps = [np.abs(stack[i + 1].astype(np.int16) - stack[i]) for i in range(0, len(stack) - 1, 4)]
    noise = 1.4826 * float(np.median(np.stack(steps))) / np.sqrt(2.0)
    return round(4 + 3 * noise)


def _neighbors(stack: np.ndarray, tolerance: int) -> np.ndarray:
    """(S, H, W) float32: number of samples of the same pixel within `tolerance` of each sample, including itself."""
    import cv2

    count = np.ones(stack.shape[:3], np.uint16)
    for i in range(len(stack)):
        for j in range(i + 1, len(stack)):
            apart = cv2.absdiff(stack[i], stack[j])
            near = largest_channel(apart) <= tolerance
            count[i] += near
            count[j] += near
    return count.astype(np.float32)


def _pick(stack: np.ndarray, score: np.ndarray, tolerance: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean color (H, W, 3) float32 of the samples similar to the best-scored one, and these samples (S, H, W) bool."""
    best = score.argmax(axis=0)
    center = np.take_along_axis(stack, best[None, :, :, None], axis=0)[0].astype(np.int16)
    members = np.stack([largest_channel(np.abs(sample - center)) <= tolerance for sample in stack])
    total = np.zeros(center.shape, np.float32)
    for sample, member in zip(stack, members, strict=True):
        total += sample * member[..., None]
    return total / members.sum(axis=0, dtype=np.float32)[..., None], members


def _estimate_small(stack: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Plate (H, W, 3) float32, its members (S, H, W) bool, known and doubtful (H, W) bool, color table or None."""
    import cv2

    tolerance = _tolerance(stack)
    density = np.log(_neighbors(stack, tolerance))
    plate, members = _pick(stack, density, tolerance)
    table: np.ndarray | None = None
    for _ in range(3):
        share = members.mean(axis=0)
        center = plate.astype(np.uint8)
        moved = np.stack([largest_channel(cv2.absdiff(sample, center)) > 26 + tolerance for sample in stack])
        swept = cv2.dilate((moved.mean(axis=0) > 0.05).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        clear = share > (0.6 if table is None else 0.3)
        if table is not None:
            clear &= odds_of_colors(table, plate, side=5) < 1.0
        front = stack[moved & clear]
        if len(front) < 200:
            # Hardly anything moves: there is no performer to learn colors from.
            everywhere = np.ones(plate.shape[:2], bool)
            return plate, members, everywhere, ~everywhere, None
        # Colors of the set count more near the performer.
        near = plate[clear & swept]
        back = np.concatenate([plate[clear], near, near])
        table = color_table(color_bins(front, _BINS), color_bins(back, _BINS), _BINS, floor=2e-5)
        colors = np.stack([odds_of_colors(table, sample, side=5) for sample in stack])
        plate, members = _pick(stack, density - colors, tolerance)
    assert table is not None
    settings = DifferenceSettings()
    covered = np.empty(stack.shape[:3], np.float32)
    for _ in range(2):
        behind = odds_of_colors(table, plate, side=5)
        for index, sample in enumerate(stack):
            image = sample.astype(np.float32)
            covered[index] = _covered(image, plate, behind, colors[index], settings)
        score = density - np.clip(covered, -3.0, 6.0)
        plate, members = _pick(stack, score, tolerance)
    members &= covered < 0.0
    best = np.take_along_axis(covered, score.argmax(axis=0)[None], axis=0)[0]
    # A color of the performer that is only visible at times may be the performer standing there.
    doubtful = (odds_of_colors(table, plate, side=5) > 0.0) & (members.mean(axis=0) < 0.85)
    return plate, members, best < 0.0, doubtful, table


def _covered(
    image: np.ndarray, plate: np.ndarray, behind: np.ndarray, colors: np.ndarray, settings: DifferenceSettings
) -> np.ndarray:
    """Log-odds that the performer covers a pixel, smoothed along edges."""
    evidence = difference_evidence(image, plate, settings)
    # If the plate looks more like the performer than the image does, the plate is wrong.
    evidence = np.where((behind - colors > 1.0) & (evidence > 0.0), -2.0, evidence) + 0.7 * colors
    gray = np.ascontiguousarray((image[..., 0] + image[..., 1] + image[..., 2]) / 765.0)
    return guided_filter(gray, evidence.astype(np.float32), radius=6)


def _full_plate(
    read: Callable[[int], np.ndarray], chosen: Sequence[int], members: np.ndarray, fallback: np.ndarray
) -> np.ndarray:
    """Full-size plate: for each pixel, the median of up to `_SLOTS` of its members, spread over time, or `fallback`."""
    import cv2

    height, width = fallback.shape[:2]
    stride = np.maximum(1, -(-members.sum(axis=0) // _SLOTS))
    slots = np.repeat(fallback.reshape(1, -1, 3), _SLOTS, axis=0)
    filled = np.zeros(height * width, np.uint8)
    seen = np.zeros(members.shape[1:], np.int64)
    for frame, member in zip(chosen, members, strict=True):
        take = member & (seen % stride == 0)
        seen += member
        wide = cv2.resize(take.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
        where = np.flatnonzero(wide)
        where = where[filled[where] < _SLOTS]
        slots[filled[where], where] = read(frame).reshape(-1, 3)[where]
        filled[where] += 1
    # Fill empty slots by repeating the others, which hardly changes the median.
    for slot in range(1, _SLOTS):
        lacking = np.flatnonzero((filled <= slot) & (filled > 0))
        slots[slot, lacking] = slots[slot % filled[lacking], lacking]
    plate = np.empty_like(slots[0])
    for start in range(0, len(plate), 1 << 18):
        plate[start : start + (1 << 18)] = np.sort(slots[:, start : start + (1 << 18)], axis=0)[_SLOTS // 2]
    return plate.reshape(height, width, 3)


def cached_background(folder: Path | None, key: str, make: Callable[[], Background]) -> Background:
    """`make()`, cached in a folder under the first 32 characters of `key`; a damaged file is replaced."""
    if folder is None:
        return make()
    path = folder / f"background_{key[:32]}_v{_VERSION}.npz"
    try:
        with np.load(path) as file:
            return Background(**{name: file[name] for name in file.files})
    except Exception as error:  # whatever NumPy, zipfile and zlib raise for a file that is missing or damaged
        if is_out_of_memory(error):
            raise
    made = make()
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        parts = {name: getattr(made, name) for name in Background.__dataclass_fields__}
        np.savez_compressed(file, allow_pickle=False, **{n: part for n, part in parts.items() if part is not None})
    return made
