"""Image filters shared by the mask sources."""

import numpy as np

_FLAT = 4e-4  # variance of a gray guide in 0..1 below which `guided_filter` takes it for flat


def reduced(image: np.ndarray, side: int) -> np.ndarray:
    """An image (H, W, ...) that is at most `side` pixels long, of the same aspect ratio; itself if it is smaller."""
    import cv2

    size = reduced_size(image, side)
    return image if size == image.shape[1::-1] else np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def reduced_size(image: np.ndarray, side: int) -> tuple[int, int]:
    """Width and height of a `reduced` image."""
    height, width = image.shape[:2]
    shrink = min(1.0, side / max(height, width))
    return max(1, round(width * shrink)), max(1, round(height * shrink))


def largest_channel(image: np.ndarray) -> np.ndarray:
    """(H, W) the largest of the first three channels of an image (H, W, 3 or more): `max(axis=2)`, which takes 25 times
    as long."""
    return np.asarray(np.maximum(np.maximum(image[..., 0], image[..., 1]), image[..., 2]))


def enlarged(mask: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A binary mask (h, w) at the size of an image of that shape: (H, W) uint8, 0 or 1."""
    import cv2

    larger = cv2.resize(mask.astype(np.float32), (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    return (larger > 0.5).astype(np.uint8)


def guided_filter(guide: np.ndarray, values: np.ndarray, radius: int) -> np.ndarray:
    """Edge-preserving smoothing of `values` (H, W) float32 (He, Sun and Tang, "Guided Image Filtering", ECCV 2010; gray
    guide, (H, W) float32 in 0..1). Windows are 2 `radius` + 1 pixels wide."""
    import cv2

    size = (2 * radius + 1, 2 * radius + 1)

    def mean(array: np.ndarray) -> np.ndarray:
        return cv2.boxFilter(array, -1, size)

    mean_guide, mean_values = mean(guide), mean(values)
    slope = (mean(guide * values) - mean_guide * mean_values) / (mean(guide * guide) - mean_guide**2 + _FLAT)
    offset = mean_values - slope * mean_guide
    return mean(slope) * guide + mean(offset)


def _density(flat: np.ndarray, bins: int) -> np.ndarray:
    """(bins, bins, bins) float32 smoothed density of colors given as their `color_bins`; sums to 1."""
    import cv2

    cube: np.ndarray = np.bincount(flat, minlength=bins**3).astype(np.float32)
    for _ in range(3):  # one axis after another
        blurred = cv2.GaussianBlur(cube.reshape(bins, bins * bins), (1, 5), sigmaX=0.0001, sigmaY=0.8)
        cube = np.ascontiguousarray(np.moveaxis(blurred.reshape(bins, bins, bins), 0, 2))
    return cube / max(float(cube.sum()), 1.0)


def color_table(front: np.ndarray, back: np.ndarray, bins: int, floor: float = 1e-5) -> np.ndarray:
    """Natural logarithm of the likelihood ratio of colors, foreground over background, from samples of both, of which
    it takes the `color_bins`, (N,) and (M,) int32: (bins, bins, bins) float32, for `odds_of_colors`. `floor` is added
    to both densities, so that colors that occur in neither get 0."""
    return np.log((_density(front, bins) + floor) / (_density(back, bins) + floor)).astype(np.float32)


def color_bins(image: np.ndarray, bins: int) -> np.ndarray:
    """(...,) int32, for (..., 3) colors in 0..255 the indices of their bins in a flattened (bins, bins, bins) table."""
    if image.dtype == np.uint8:
        index = (np.arange(256, dtype=np.int32) * bins // 256)[image]
    else:
        index = (image * image.dtype.type(bins / 256.0)).astype(np.int32)
        np.clip(index, 0, bins - 1, out=index)
    return (index[..., 0] * bins + index[..., 1]) * bins + index[..., 2]


def odds_of_colors(table: np.ndarray, image: np.ndarray, limit: float = 4.0, side: int = 3) -> np.ndarray:
    """(H, W) values of a `color_table` at the colors of an (H, W, 3) image in 0..255, clipped to +-`limit`: their mean
    in squares of `side` pixels."""
    import cv2

    return cv2.blur(np.clip(table.reshape(-1)[color_bins(image, table.shape[0])], -limit, limit), (side, side))


def brightness(image: np.ndarray) -> np.ndarray:
    """(H, W) float32 mean of the channels of an (H, W, 3) image in 0..255, 0 to 1."""
    import cv2

    return np.asarray(cv2.transform(image.astype(np.float32, copy=False), np.full((1, 3), 1 / 765)))


def masked_mean(image: np.ndarray, mask: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian mean of an (H, W, C) float32 image, weighted by a mask (H, W) in 0..1, with a standard deviation of
    `sigma` pixels: (H, W, C) float32, and (H, W) float32 its total weight in 0..1."""
    import cv2

    given = mask.astype(np.float32)
    weight = cv2.GaussianBlur(given, (0, 0), sigma)
    total = cv2.GaussianBlur(image * given[..., None], (0, 0), sigma).reshape(image.shape)
    return total / np.maximum(weight, 1e-6)[..., None], weight


def touching(area: np.ndarray, hint: np.ndarray) -> np.ndarray:
    """The components of an area (H, W) bool that have pixels of a hint (H, W) bool."""
    import cv2

    _, labels = cv2.connectedComponents(area.astype(np.uint8))
    return area & np.isin(labels, np.unique(labels[area & hint]))


def keep_components(
    mask: np.ndarray,
    components: int | None,
    minimum: int,
    core: np.ndarray | None = None,
    likeness: np.ndarray | None = None,
) -> np.ndarray:
    """Remove small components of a binary mask and fill small holes: (H, W) uint8, 0 or 1.

    Args:
        mask: (H, W) uint8, 0 or 1, or bool.
        components: maximum number of components, largest first; None: no limit.
        minimum: area in pixels; smaller components are removed and smaller holes filled. Components below 1% of the
            area of the largest one are also removed.
        core: (H, W) bool; components without at least 2x2 such pixels are removed.
        likeness: (H, W) float32; components whose mean is below half that of the largest one are removed (mostly
            reflections).
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
