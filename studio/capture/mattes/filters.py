"""Small image operations that masks are made with."""

from __future__ import annotations

import numpy as np


def guided_filter(guide: np.ndarray, values: np.ndarray, radius: int, epsilon: float) -> np.ndarray:
    """Smooth `values` along the edges of `guide` (He, Sun and Tang, "Guided Image Filtering", 2010, gray guide).

    Args:
        guide: (H, W) float32 in 0..1.
        values: (H, W) float32.
        radius: pixels; windows are 2 radius + 1 wide.
        epsilon: variance of the guide below which it counts as flat.
    """
    import cv2

    size = (2 * radius + 1, 2 * radius + 1)

    def mean(array: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(array, -1, size)

    mean_guide, mean_values = mean(guide), mean(values)
    slope = (mean(guide * values) - mean_guide * mean_values) / (mean(guide * guide) - mean_guide**2 + epsilon)
    offset = mean_values - slope * mean_guide
    return mean(slope) * guide + mean(offset)


def color_histogram(colors: np.ndarray, bins: int = 16) -> np.ndarray:
    """(bins, bins, bins) smoothed density of (N, 3) colors in 0..255, summing to 1."""
    import cv2

    index = np.clip((colors * (bins / 256.0)).astype(np.int32), 0, bins - 1)
    flat = (index[:, 0] * bins + index[:, 1]) * bins + index[:, 2]
    cube: np.ndarray = np.bincount(flat, minlength=bins**3).astype(np.float32)
    for _ in range(3):  # one axis after another, by turning the cube
        blurred = cv2.GaussianBlur(cube.reshape(bins, bins * bins), (1, 5), sigmaX=0.0001, sigmaY=0.8)
        cube = np.ascontiguousarray(np.moveaxis(blurred.reshape(bins, bins, bins), 0, 2))
    return cube / max(float(cube.sum()), 1.0)


def color_table(front: np.ndarray, back: np.ndarray, bins: int = 16, floor: float = 1e-5) -> np.ndarray:
    """How much likelier colors are among `front` than among `back`, natural log.

    Args:
        front, back: (N, 3) sample colors in 0..255.
        bins: a channel.
        floor: density below which a color counts as not seen; 0 is returned where neither has it.

    Returns:
        (bins, bins, bins) float32, for `look_up`.
    """
    ratio = (color_histogram(front, bins) + floor) / (color_histogram(back, bins) + floor)
    return np.log(ratio).astype(np.float32)


def look_up(table: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(H, W) values of a `color_table` at the colors of an (H, W, 3) image in 0..255."""
    bins = table.shape[0]
    if image.dtype == np.uint8:
        index = (np.arange(256, dtype=np.int32) * bins // 256)[image]
    else:
        index = np.clip((image * (bins / 256.0)).astype(np.int32), 0, bins - 1)
    return table.reshape(-1)[(index[..., 0] * bins + index[..., 1]) * bins + index[..., 2]]


def masked_mean(image: np.ndarray, mask: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian mean of the pixels where `mask` is 1, and the weight that it rests on (0 to 1).

    Args:
        image: (H, W, 3) float32.
        mask: (H, W) uint8, 0 or 1.
    """
    import cv2

    weight = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma)
    total = cv2.GaussianBlur(image * mask[..., None].astype(np.float32), (0, 0), sigma)
    return total / np.maximum(weight, 1e-6)[..., None], weight


def keep_components(
    mask: np.ndarray,
    components: int,
    minimum: int,
    core: np.ndarray | None = None,
    likeness: np.ndarray | None = None,
) -> np.ndarray:
    """The connected pieces of a binary mask that are no noise, with small holes filled.

    Args:
        mask: (H, W) uint8, 0 or 1, or bool.
        components: how many pieces to keep, largest first; 0 keeps all that reach `minimum` and a hundredth of the
            largest.
        minimum: pixels; smaller pieces go, smaller holes are filled.
        core: (H, W) bool; a piece without any such pixels (2x2 at least) goes.
        likeness: (H, W) float32; a piece whose mean is below half of the largest piece's goes (reflections, mostly).
    """
    import cv2

    mask = mask.astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count == 1:
        return mask
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    if core is not None:
        solid = cv2.erode(core.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0
        seen = np.zeros(count, bool)
        seen[np.unique(labels[solid & (mask > 0)])] = True
        areas[~seen] = 0
    if likeness is not None and areas.any():
        means = np.bincount(labels.reshape(-1), weights=likeness.reshape(-1), minlength=count) / np.maximum(
            stats[:, cv2.CC_STAT_AREA], 1
        )
        areas[means < 0.5 * means[int(areas.argmax())]] = 0
    order = np.argsort(-areas, kind="stable")
    wanted = [label for label in order[: components or None] if areas[label] >= max(minimum, 1, 0.01 * areas.max())]
    keep = np.zeros(count, np.uint8)
    keep[wanted] = 1
    kept = keep[labels]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(1 - kept, connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < minimum
    small[0] = False
    kept[small[labels]] = 1
    return kept
