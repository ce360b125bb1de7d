"""Chroma key: a soft mask from an image in front of a screen of one color.

Steps: per-pixel evidence (the angle between the pixel's color and the screen's, relative to the screen's spread and the
noise; and pixels far darker than any shadow), edge-preserving smoothing, the same cleanup as for clean plates, and at
the silhouette a mask solved from the screen color next to the performer: I = a F + (1 - a) B.
"""

import math
from collections.abc import Sequence

import numpy as np

from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.clean_plate import edge_reach, noise_of, solve_edges
from v3studio.studio.masks.despill import despill
from v3studio.studio.masks.filters import brightness, enlarged, guided_filter, keep_components, masked_mean, reduced
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource, evenly_spaced
from v3studio.studio.masks.screen_color import Screen, certain_screen, find_screen
from v3studio.studio.memory_cache import MemoryCache

_CAMERAS = 9  # most cameras in which auto looks for a screen
SAMPLES = 5  # number of frames per camera from which the screen color is estimated
WORK_SIDE = 1920  # longest side for computing evidence; edges are solved at full size
_FEW = 0.02  # share of known pixels at which their mean counts for half
_FLOOR = 0.06  # tangent of the angle by which reflections and compression may change the screen color
_DEEPEST_SHADOW = 0.3  # fraction of the screen's brightness nearby; darker pixels have no usable color
_NO_SHADOW = 0.75


def chroma_mask(
    image: np.ndarray, screen: Screen, settings: DifferenceSettings, inside: np.ndarray | None = None
) -> np.ndarray:
    """Mask of an image (H, W, 3) uint8 RGB in front of a screen: (H, W) uint8, 255 = foreground, soft at the edges.
    `inside`: (H, W) bool, where the performer may be; None: everywhere."""
    small_inside = None if inside is None else reduced(inside.astype(np.uint8), WORK_SIDE) > 0
    solid = _binary(reduced(image, WORK_SIDE).astype(np.float32), screen, settings, small_inside)
    if not solid.any():
        return np.zeros(image.shape[:2], np.uint8)
    solid, reach = enlarged(solid, image.shape), edge_reach(image, WORK_SIDE)
    mask = solve_edges(image, screen_behind(image, solid), np.ones(3, np.float32), solid, reach, None)
    return mask if inside is None else mask * inside.astype(np.uint8)


def key_evidence(image: np.ndarray, screen: Screen, settings: DifferenceSettings) -> np.ndarray:
    """Log-odds of foreground from color, (H, W) float32: -4 (screen) to 6 (certainly foreground)."""
    import cv2

    soft = cv2.GaussianBlur(image, (0, 0), 0.8)
    noise = float(noise_of(image - cv2.blur(image, (3, 3))).mean()) / 2.2  # as reduced by the blur
    tangents, along = screen.tangents(soft)
    angle = tangents[..., 0] ** 2 + tangents[..., 1] ** 2
    variance = screen.spread**2 + _FLOOR**2 + (noise / along) ** 2
    by_angle = 1.2 * (np.sqrt(angle / variance) * settings.mask_sensitivity - 4.0)
    # Local brightness of the screen, from pixels that are certainly screen; it includes shadows if they are ignored.
    typical = float(np.linalg.norm(screen.color))
    least, reach = (_DEEPEST_SHADOW, 0.04) if settings.mask_shadows != "none" else (_NO_SHADOW, 0.2)
    plain = ((by_angle < -1.0) & (along > _DEEPEST_SHADOW * typical)).astype(np.uint8)
    everywhere = np.array([typical], np.float32)
    light = _extrapolate(along[..., None], plain, reach * max(image.shape[:2]), everywhere)[..., 0]
    by_darkness = 40.0 * (least * min(settings.mask_sensitivity, 1.3) - along / light)
    return np.clip(np.maximum(by_angle, by_darkness), -4.0, 6.0).astype(np.float32)


def _binary(image: np.ndarray, screen: Screen, settings: DifferenceSettings, inside: np.ndarray | None) -> np.ndarray:
    """(H, W) uint8, 0 or 1, of a float32 image; see `chroma_mask`."""
    evidence = key_evidence(image, screen, settings)
    if inside is not None:
        evidence[~inside] = -4.0
    smooth = guided_filter(brightness(image), evidence, radius=2)
    mask = (smooth > 0.0).astype(np.uint8)
    return keep_components(mask, settings.mask_components, int(1e-4 * mask.size), core=evidence > 4.0)


def screen_behind(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The screen without the performer, extrapolated from the screen beside them: (H, W, 3) uint8 RGB."""
    import cv2

    reach = edge_reach(image, WORK_SIDE)
    radius = int(np.ceil(1.5 * reach))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    plain = 1 - cv2.dilate(mask, disc)
    everywhere = image[plain > 0] if plain.any() else image.reshape(-1, 3)
    middle = np.median(everywhere[::17], axis=0).astype(np.float32)
    screen_color = _extrapolate(image.astype(np.float32), plain, 3 * reach, middle)
    return np.rint(np.clip(screen_color, 0, 255)).astype(np.uint8)


def _extrapolate(colors: np.ndarray, where: np.ndarray, sigma: float, otherwise: np.ndarray) -> np.ndarray:
    """Local mean of the (H, W, C) `colors` where `where` is 1, extrapolated to the rest.

    Uses Gaussian means with standard deviation `sigma`, or 4 and 16 times `sigma` where too few pixels are near, and
    `otherwise` (C,) where there are none at all. A mean counts for half where a share of `_FEW` of its pixels is known.
    """
    import cv2

    height, width = where.shape
    result: np.ndarray = np.broadcast_to(otherwise, colors.shape).astype(np.float32)
    for factor in (16.0, 4.0, 1.0):
        shrink = min(1.0, 4.0 / (factor * sigma))  # a wide mean does not need full resolution
        size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
        weight = cv2.resize(where.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        weighted = cv2.resize(colors * where[..., None].astype(np.float32), size, interpolation=cv2.INTER_AREA)
        weighted = weighted.reshape(*weight.shape, -1) / np.maximum(weight, 1e-6)[..., None]
        mean, seen = masked_mean(weighted, weight, factor * sigma * shrink)
        mean = cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR).reshape(colors.shape)
        seen = cv2.resize(seen, (width, height), interpolation=cv2.INTER_LINEAR)[..., None]
        trust = seen / (seen + _FEW)
        result = trust * mean + (1.0 - trust) * result
    return result


class ChromaMaskSource(MaskSource):
    """A `MaskSource` whose foreground is everything that differs from the screen's color.

    Spill is removed from the performer's outline (see `Recolors`). `key`: see `find_screen`.
    """

    def __init__(self, inputs: MaskInputs, key: Sequence[float] | None) -> None:
        self._inputs, self._key = inputs, key
        self._screens: MemoryCache[str, Screen] = MemoryCache(math.inf)

    def screen(self, camera: str) -> Screen:
        """The screen of a camera, found once. Raises StudioError as `find_screen`."""
        return self._screens.get_or_make(camera, self._find)

    def _find(self, camera: str) -> Screen:
        frames = self._inputs.sources[camera].frames
        images = [self._inputs.image(camera, frame) for frame in evenly_spaced(frames, SAMPLES)]
        return find_screen(images, camera, self._key)

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError as `find_screen`."""
        image = np.ascontiguousarray(image[:, :, :3])
        inside = self._inputs.inside(camera, frame, image)
        return chroma_mask(image, self.screen(camera), self._inputs.spec, inside)

    def recolored(self, camera: str, image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        behind = screen_behind(image, (mask > 127).astype(np.uint8))
        return despill(image, mask, behind, self.screen(camera).color)


def open_chroma_key(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Open masks from a screen, for `SOURCES`."""
    key = inputs.spec.key_color
    if required or not isinstance(key, str):
        return ChromaMaskSource(inputs, None if isinstance(key, str) else key), "chroma key"
    some = evenly_spaced(inputs.names, _CAMERAS)
    try:
        found = certain_screen([inputs.first_image(name) for name in some], some)
    except StudioError:  # an unreadable file, which is reported when it is needed
        return None
    return found and (ChromaMaskSource(inputs, found[1]), f"chroma key of a {found[0]} screen")
