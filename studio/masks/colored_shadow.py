"""Shadows on the set in footage with clean plates whose factor is not the same in all channels, or very dark.

Each channel of a shadow is the plate's times a factor of its own, because each light has a color. A performer who is
darker than a plain set looks like that as well, so the texture of the plate has to show through.
"""

import numpy as np

from v3studio.studio.masks.filters import largest_channel

WINDOW = (9, 9)  # pixels in which footage and plate are compared
_LEAST_FACTOR = 0.12  # of a colored shadow: what is darker is no shadow
_BRIGHTEST = 1.08  # factor of a channel up to which it is a shadow
_FACTOR_BINS = 14  # per channel, of the factors of colored shadows
_LEAST_SLOPE = 0.3  # of a shadow's texture on the plate's; compression blurs it
_NEIGHBORS = 6.0  # pixels whose noise is alike, after blur and compression
_SMALL, _NEARBY, _RIM = (5, 5), (15, 15), (7, 7)  # windows in which the footage's own texture decides
_LEAST_PIXELS = 30  # of a shadow, or nearby


def colored_shadow(
    ours: np.ndarray, empty: np.ndarray, image: np.ndarray, plate_image: np.ndarray, noise: np.float32
) -> np.ndarray | None:
    """Shadows that change the color of the set, as shadows of several colored lights do, or that are very dark.

    A shadow multiplies each channel by a factor of its own, so a performer who is darker than a plain set looks like
    one. The texture of the plate decides: if it shows through where the factors are alike, they belong to a shadow,
    also where the set is too plain to tell, and so is everything between them and no shadow, its edges. Where the plate
    has texture and the footage nearby lacks it, there is no shadow, whatever the factors.

    Takes the luma (H, W) and the RGB (H, W, 3) of image and plate in 0..255, and the standard deviation of the luma's
    noise; returns (H, W) float32 in 0..1, 1 in such shadows, or None if there are none.
    """
    import cv2

    factors = cv2.blur(image, WINDOW) / np.maximum(cv2.blur(plate_image, WINDOW), 4.0)
    own, plate, common, factor = _textures(ours, empty, WINDOW)
    dark = (factor > _LEAST_FACTOR) & (factor < 0.97) & (largest_channel(factors) < _BRIGHTEST)
    if not dark.any():
        return None
    # Sums over pixels with about the same factors, for the regression of the footage's texture on the shaded plate's.
    flat = _factor_bins(factors)
    foreign = own > 3.0 * plate + np.float32(3.0 * noise) ** 2  # texture that the plate does not have
    asked = dark & ~foreign
    count, owns, plates, commons = (
        _sum_nearby(flat[asked], weight[asked]) for weight in (np.ones_like(own), own, plate, common)
    )
    slope, error = _regression(count, owns, plates, commons)
    sure = (slope - 2 * error > _LEAST_SLOPE) & (slope < 1.8) & (count > _LEAST_PIXELS)
    if not sure.any():
        return None
    near = cv2.blur(image, (3, 3)) / np.maximum(cv2.blur(plate_image, (3, 3)), 4.0)
    shaded = _with_penumbra(sure).reshape(-1)[_factor_bins(near)]
    shaded &= largest_channel(near) < _BRIGHTEST
    area = (shaded & ~_without_texture(ours, empty, shaded & asked)).astype(np.uint8)
    area = cv2.morphologyEx(area, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    return cv2.morphologyEx(area, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)).astype(np.float32)


def _textures(ours: np.ndarray, empty: np.ndarray, window: tuple[int, int]) -> tuple[np.ndarray, ...]:
    """Variances (H, W) of the footage and of the plate times the local factor, their covariance, and that factor, in
    windows."""
    import cv2

    first, second = cv2.blur(ours, window), cv2.blur(empty, window)
    factor = first / np.maximum(second, 1.0)
    own = np.maximum(cv2.blur(ours * ours, window) - first * first, 0.0)
    plate = np.maximum(cv2.blur(empty * empty, window) - second * second, 0.0) * factor * factor
    return own, plate, (cv2.blur(ours * empty, window) - first * second) * factor, factor


def _without_texture(ours: np.ndarray, empty: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Pixels, (H, W) bool, where the plate has texture, but where the footage lacks it in the pixels nearby that are in
    `asked`."""
    import cv2

    weight = asked.astype(np.float32)
    parts = (weight, *(weight * part for part in _textures(ours, empty, _SMALL)[:3]))
    count, own, plate, common = (cv2.boxFilter(part, -1, _NEARBY, normalize=False) for part in parts)
    slope, error = _regression(count, own, plate, common)
    is_plain = ((slope + 2 * error < _LEAST_SLOPE) & (count > _LEAST_PIXELS)).astype(np.uint8)
    return cv2.dilate(is_plain, np.ones(_RIM, np.uint8)) > 0  # at the outline, windows also hold the set


def _regression(
    count: np.ndarray, own: np.ndarray, plate: np.ndarray, common: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slope of the footage's texture on the shaded plate's, from sums of (co)variances; and its standard error."""
    slope = common / np.maximum(plate, 1e-3)
    rest = np.maximum(own - 2 * slope * common + slope * slope * plate, 0.0) / np.maximum(count, 1e-3)
    return slope, np.sqrt(_NEIGHBORS * (rest + 0.25) / np.maximum(plate, 1e-3))


def _factor_bins(factors: np.ndarray) -> np.ndarray:
    """(H, W) int32 indices of factors (H, W, 3) in a flattened (B, B, B) table."""
    bins = np.clip(factors * (_FACTOR_BINS / _BRIGHTEST), 0, _FACTOR_BINS - 1).astype(np.int32)
    return np.asarray((bins[..., 0] * _FACTOR_BINS + bins[..., 1]) * _FACTOR_BINS + bins[..., 2])


def _with_penumbra(sure: np.ndarray) -> np.ndarray:
    """Bins, (B, B, B) bool, of shadows and of their edges, which are all bins between a shadow and no shadow."""
    width = _BRIGHTEST / _FACTOR_BINS
    depth = 1 - (np.argwhere(sure) + 0.5) * width
    passes = np.zeros_like(sure)
    for share in np.linspace(0.2, 1.0, 13):
        passes[tuple(np.clip((1 - share * depth) / width, 0, _FACTOR_BINS - 1).astype(int).T)] = True
    return passes


def _sum_nearby(flat: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(B, B, B) float32 sums of weights (N,) in the bins (N,) of factors; neighboring bins count half."""
    import cv2

    cube = np.bincount(flat, weight, minlength=_FACTOR_BINS**3).astype(np.float32)
    for _ in range(3):  # one axis after another
        rows = cv2.filter2D(cube.reshape(_FACTOR_BINS, -1), -1, np.array([[0.5], [1.0], [0.5]], np.float32))
        cube = np.ascontiguousarray(np.moveaxis(rows.reshape((_FACTOR_BINS,) * 3), 0, 2))
    return cube
