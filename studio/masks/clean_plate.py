"""Clean plate: a soft mask from an image and a second image of the empty set, taken by the same camera.

Steps: per-pixel evidence (difference from the plate in units of the noise, discounting shadows; then the likelihood
ratio of the color in foreground and background), edge-preserving smoothing of the evidence (a guided filter, He et al.
2010, instead of a graph cut), connected components, and at the silhouette a mask solved from the known background:
I = a F + (1 - a) B.
"""

from dataclasses import dataclass

import numpy as np

from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.masks import filters
from v3studio.studio.masks.colored_shadow import WINDOW, colored_shadow

_NO_CHROMA = 127.5  # value of Cr and Cb for gray
_FADED = 4.0  # in chroma levels: a smaller loss of chroma in a shadow is ignored
_SLOPE_VARIANCE = np.array([0.15**2, 0.5**2, 0.5**2], np.float32)  # of Y, Cr and Cb, per squared slope of the plate
_LEAST_VARIANCE = np.array([9.0, 2.25, 2.25], np.float32)
_TOO_DARK, _TOO_BRIGHT = (float(np.nextafter(np.float32(20), 255)),) * 3, (float(np.nextafter(np.float32(240), 0)),) * 3
"""Inclusive bounds of the plate's channels where it tells the exposure: above 20 and below 240."""
_COLOR_BINS = 16  # per channel, of the colors of one image
WORK_SIDE = 960  # longest side for computing evidence; edges are solved at full size


@dataclass(frozen=True, eq=False)
class Background:
    """The set behind the performer in one camera."""

    plate: np.ndarray  # (H, W, 3) uint8 RGB
    known: np.ndarray | None = None  # (H, W) bool, where the plate is reliable; None: everywhere, a clean plate
    # (H, W) bool, where the plate has a color of the performer that is only visible at times, so that it may show the
    # performer standing still; None for a clean plate
    doubtful: np.ndarray | None = None
    colors: np.ndarray | None = None  # `color_table` of performer and set; None if the performer's were not learned
    agreed: np.ndarray | None = None  # (H, W) bool, where all cameras agree that it shows the set; None: not compared

    @property
    def nbytes(self) -> int:
        """Its size in memory."""
        return sum(part.nbytes for part in vars(self).values() if part is not None)


def noise_of(difference: np.ndarray) -> np.ndarray:
    """(C,) robust standard deviations of an image difference, mostly background; at least 0.7 (8-bit rounding)."""
    return np.array([_noise(channel) for channel in np.moveaxis(difference, -1, 0)], np.float32)


def _noise(difference: np.ndarray) -> np.float32:
    """`noise_of` one channel, (H, W)."""
    flat = difference.reshape(-1)[::7]
    spread = np.float32(1.4826) * np.median(np.abs(flat - np.median(flat)))
    return np.float32(max(spread, np.float32(0.7)))


def match_exposure(image: np.ndarray, plate: np.ndarray, known: np.ndarray | None = None) -> np.ndarray:
    """Per-channel gain that matches the plate to the image's exposure and white balance, both (H, W, 3) float32 in
    0..255: (3,) float32 median of ratios, clamped to 0.7..1.4; ones if fewer than 500 pixels are usable. `known`:
    (H, W) bool, which pixels to use; None: all."""
    import cv2

    usable = cv2.inRange(plate, _TOO_DARK, _TOO_BRIGHT).reshape(-1) != 0
    if known is not None:
        usable &= known.reshape(-1)
    chosen = np.flatnonzero(usable)
    if chosen.size < 500:
        return np.ones(3, np.float32)
    chosen = chosen[::5]
    ratio = image.reshape(-1, 3)[chosen] / plate.reshape(-1, 3)[chosen]
    return np.array([np.clip(np.median(channel), 0.7, 1.4) for channel in ratio.T.copy()], np.float32)


def difference_evidence(image: np.ndarray, plate: np.ndarray, settings: DifferenceSettings) -> np.ndarray:
    """Log-odds of foreground from the difference from the plate alone: -4 (equal) to 6, (H, W) float32."""
    import cv2

    # One contiguous array per channel, modified in place: NumPy is several times slower on interleaved channels.
    luma_chroma, blurred = [], []
    for pixels in (image, plate):
        # Chroma is usually subsampled: blur it more than luma.
        scaled: np.ndarray = cv2.GaussianBlur(pixels, (0, 0), 0.7)
        if settings.mask_shadows == "colored":
            blurred.append(scaled.copy())
        scaled /= 255.0
        channels: list[np.ndarray] = list(cv2.split(cv2.cvtColor(scaled, cv2.COLOR_RGB2YCrCb)))
        for index, channel in enumerate(channels):
            channel *= np.float32(255.0)
            if index:
                channels[index] = cv2.GaussianBlur(channel, (0, 0), 1.3)
        luma_chroma.append(channels)
    ours, empty = luma_chroma
    difference = [texture - empty_texture for texture, empty_texture in zip(ours, empty, strict=True)]
    noise = [_noise(channel) for channel in difference]
    shadow, factor = _shadow(ours[0], empty[0], noise[0]) if settings.mask_shadows != "none" else (None, None)
    colored = settings.mask_shadows == "colored"
    tinted = colored_shadow(ours[0], empty[0], blurred[0], blurred[1], noise[0]) if colored else None
    total: np.ndarray = np.zeros_like(ours[0])
    for index, (channel, other) in enumerate(zip(difference, empty, strict=True)):
        # Tolerate slight misregistration and ringing at edges of the plate.
        variance: np.ndarray = cv2.Sobel(other, cv2.CV_32F, 1, 0, scale=1 / 8)
        down: np.ndarray = cv2.Sobel(other, cv2.CV_32F, 0, 1, scale=1 / 8)
        variance *= variance
        down *= down
        variance += down
        variance *= _SLOPE_VARIANCE[index]
        variance += noise[index] * noise[index]
        if shadow is not None and factor is not None:
            if index == 0:
                variance += shadow * (channel * channel)
            else:
                # shadow reduces chroma by the same factor, which matters where the set is colorful
                faded = other - np.float32(_NO_CHROMA)
                faded *= shadow * (1 - factor)
                trusted = np.abs(faded)
                trusted -= np.float32(_FADED)
                np.clip(trusted, 0.0, 1.0, out=trusted)
                trusted *= faded
                channel += trusted
        if tinted is not None:
            variance += tinted * (channel * channel)
        # This floor suppresses faint reflections and flicker in very clean footage.
        variance += _LEAST_VARIANCE[index]
        channel *= channel
        channel /= variance
        total += channel
    np.sqrt(total, out=total)
    total *= np.float32(settings.mask_sensitivity)
    total -= np.float32(4.0)
    total *= np.float32(1.2)
    return np.clip(total, -4.0, 6.0, out=total)


def _shadow(ours: np.ndarray, empty: np.ndarray, noise: np.float32) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) in 0..1, 1 where luma nearby is the plate's times a constant below 1 (a shadow); and that constant."""
    import cv2

    size = WINDOW
    pairs = ((ours, empty), (empty, empty), (ours, ours))
    factor, empties, residual = (cv2.boxFilter(first * second, -1, size) for first, second in pairs)
    products = factor.copy()
    np.maximum(empties, np.float32(1.0), out=empties)
    factor /= empties
    products *= factor
    residual -= products  # mean squared error of ours = factor * empty
    np.maximum(residual, np.float32(0.0), out=residual)
    residual /= np.float32(-2.0 * (9.0 + (1.5 * noise) ** 2))
    np.exp(residual, out=residual)
    residual *= (factor > 0.45) & (factor < 0.99)
    return residual, factor


def difference_mask(image: np.ndarray, behind: Background, settings: DifferenceSettings) -> np.ndarray:
    """Mask of an image (H, W, 3) uint8 RGB by comparison with the set: (H, W) uint8, 255 = foreground, soft edges.

    Where the plate is not known, only colors are used, which are learned from this image if `behind` has none. Where it
    is doubtful, similarity to the plate makes no hole.
    """
    ours, empty = (filters.reduced(pixels, WORK_SIDE).astype(np.float32) for pixels in (image, behind.plate))
    known, doubtful = (
        None if area is None else filters.reduced(area.astype(np.uint8), WORK_SIDE) > 0
        for area in (behind.known, behind.doubtful)
    )
    gain = match_exposure(ours, empty, known)
    empty *= gain
    mask = foreground_mask(ours, Background(empty, known, doubtful, behind.colors), settings)
    if not mask.any():
        return np.zeros(image.shape[:2], np.uint8)
    reach = edge_reach(image, WORK_SIDE)
    return solve_edges(image, behind.plate, gain, filters.enlarged(mask, image.shape), reach, behind.known)


def foreground_mask(image: np.ndarray, behind: Background, settings: DifferenceSettings) -> np.ndarray:
    """Binary foreground (H, W) uint8, 0 or 1, of a float32 image and plate in 0..255; see `difference_mask`."""
    import cv2

    known, doubtful = behind.known, behind.doubtful
    evidence = difference_evidence(image, behind.plate, settings)
    sure, empty = evidence > 4.0, evidence < -1.0
    ratio: np.ndarray | None = None
    if behind.colors is not None:
        ratio = filters.odds_of_colors(behind.colors, image)
        if known is not None:
            evidence = np.where(known, evidence, ratio)
        evidence += 0.7 * ratio
        sure &= ratio > -1.0
    else:
        if known is not None:
            evidence = np.where(known, evidence, 0.0).astype(np.float32)
        if sure.sum() > 50:
            colored = filters.color_bins(image, _COLOR_BINS)
            table = filters.color_table(colored[sure], colored[empty], _COLOR_BINS)
            evidence += 0.7 * np.clip(table, -3.0, 3.0).reshape(-1)[colored]
    smooth = filters.guided_filter(filters.brightness(image), evidence, radius=3)
    mask = (smooth > 0.0).astype(np.uint8)
    minimum = int(1e-4 * mask.size)
    mask = filters.keep_components(mask, settings.mask_components, minimum, core=sure, likeness=ratio)
    if doubtful is None or ratio is None or not mask.any():
        return mask
    # Where the plate may show the performer, close concavities and holes that have the performer's colors.
    reach = max(1, round(0.04 * max(cv2.boundingRect(mask)[2:])))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    padded = cv2.copyMakeBorder(mask, reach, reach, reach, reach, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[reach:-reach, reach:-reach]
    outside = cv2.copyMakeBorder(closed, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    cv2.floodFill(outside, None, (0, 0), 2)
    enclosed = outside[1:-1, 1:-1] != 2
    added = enclosed & doubtful & (cv2.blur(ratio, (5, 5)) > 0.2)
    return filters.keep_components((mask > 0) | added, settings.mask_components, minimum, core=sure, likeness=ratio)


def edge_reach(image: np.ndarray, side: int) -> float:
    """Width in pixels of the band around the silhouette that may have mixed colors: 2 for images up to `side` long."""
    return 2.0 * max(1.0, max(image.shape[:2]) / side)


def solve_edges(
    image: np.ndarray, plate: np.ndarray, gain: np.ndarray, solid: np.ndarray, reach: float, known: np.ndarray | None
) -> np.ndarray:
    """Soften a binary mask: within `reach` pixels of the silhouette, solve I = a F + (1 - a) B for a.

    F is the mean foreground color just inside, B the plate times its `gain` (3,). If the two are too similar, a depends
    on the distance from the silhouette instead. Takes image and plate (H, W, 3) uint8, `solid` (H, W) uint8, 0 or 1,
    and `known` (H, W) bool, where the plate is reliable (None: everywhere); returns the mask, (H, W) uint8.
    """
    import cv2

    height, width = solid.shape
    mask = solid * np.uint8(255)
    left, top, across, down = cv2.boundingRect(solid)
    margin = int(np.ceil(4 * reach))
    rows = slice(max(0, top - margin), min(height, top + down + margin))
    columns = slice(max(0, left - margin), min(width, left + across + margin))
    inner = solid[rows, columns]
    radius = int(np.ceil(reach))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    core, grown = cv2.erode(inner, disc), cv2.dilate(inner, disc)
    ours = image[rows, columns].astype(np.float32)
    behind = plate[rows, columns].astype(np.float32) * gain
    front, weight = filters.masked_mean(ours, core, 1.5 * reach)
    contrast = front - behind
    total = np.ones((1, 3), np.float32)
    power = cv2.transform(contrast * contrast, total)
    by_color = cv2.transform((ours - behind) * contrast, total) / np.maximum(power, 1.0)
    by_place = cv2.GaussianBlur(inner.astype(np.float32), (0, 0), 0.5 * reach)
    # Standard deviation of alpha from color: noise and texture of about 12 levels; from the distance: 0.25.
    trust = power / (12.0**2 * 3) * 0.25**2 * 16
    trust = np.where(weight > 1e-3, trust, 0.0)
    if known is not None:
        trust = np.where(known[rows, columns], trust, 0.0)
    alpha = (trust * np.clip(by_color, 0.0, 1.0) + by_place) / (trust + 1.0)
    band = (grown > 0) & (core == 0)
    mask[rows, columns] = np.where(band, np.rint(255.0 * alpha), mask[rows, columns]).astype(np.uint8)
    return mask
