"""Matches between the images of a rig, found without its cameras, and how many of them its epipolar lines fit.

A small reprojection error only says that a rig fits the points it was made from. This evidence is independent: it also
judges cameras from a file, and a rig that a repeating wall has folded.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.progress import ProgressFn, no_progress

LONGEST = 960  # images are reduced to this many pixels on their longer side
_FEATURES, _STRONGEST = 1200, 300
"""Features per image, and those with which pairs of images are found that show the same."""
_PARTNERS = 5  # images with which each is matched
_RATIO = 0.8  # Lowe's ratio: the best match is at most this far compared with the second best
LEAST_MATCHES = 20  # A pair with fewer verified matches is no evidence
TOLERANCE = 0.003
"""Distance from the epipolar line that counts as a fit, as a fraction of the longer side: 2 pixels of 640."""

_CLOSE = 1e-6  # of their distance from the origin: cameras that are nearer to each other are at one place, and have no
# epipolar lines

_Features: TypeAlias = tuple[np.ndarray, np.ndarray]  # pixels (F, 2), descriptors (F, 128)


@dataclass(frozen=True)
class PairMatches:
    """Verified matches of two images. `first_pixels`, `second_pixels`: (M, 2) float64 in full-size images."""

    first: str
    second: str
    first_pixels: np.ndarray
    second_pixels: np.ndarray


def match_images(images: Mapping[str, np.ndarray], *, progress: ProgressFn = no_progress) -> list[PairMatches]:
    """Match each (H, W, 3) uint8 RGB image, undistorted, with the most similar ones; the verified pairs."""
    names = list(images)
    features: dict[str, _Features] = {}
    for number, name in enumerate(names):
        features[name] = _features(images[name])
        progress(number, 2 * len(names))
    strongest = {name: (pixels[:_STRONGEST], codes[:_STRONGEST]) for name, (pixels, codes) in features.items()}
    alike = {pair: len(_match(strongest[pair[0]], strongest[pair[1]])) for pair in combinations(names, 2)}
    wanted: set[tuple[str, str]] = set()
    for name in names:
        own = [pair for pair in alike if name in pair]
        wanted.update(sorted(own, key=lambda pair: -alike[pair])[:_PARTNERS])
    pairs = []
    for number, (first, second) in enumerate(sorted(wanted)):
        verified = _verified(features[first], features[second])
        if len(verified) >= LEAST_MATCHES:
            pairs.append(PairMatches(first, second, verified[:, :2], verified[:, 2:]))
        progress(len(wanted) + number, 2 * len(wanted))
    return pairs


def _features(image: np.ndarray) -> _Features:
    import cv2

    scale = min(1.0, LONGEST / max(image.shape[:2]))
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    points, codes = cv2.SIFT.create(_FEATURES, contrastThreshold=0.02).detectAndCompute(gray, None)
    if codes is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    order = np.argsort([-point.response for point in points], kind="stable")
    pixels = (np.array([point.pt for point in points], np.float64) + 0.5) / scale
    # RootSIFT (Arandjelovic and Zisserman 2012)
    roots = np.sqrt(codes / np.maximum(codes.sum(1, keepdims=True), 1e-9)).astype(np.float32)
    return pixels[order], roots[order]


def _match(first: _Features, second: _Features) -> np.ndarray:
    """(M, 2) indices of mutual nearest neighbors that pass the ratio test."""
    import cv2

    if min(len(first[1]), len(second[1])) < 2:
        return np.zeros((0, 2), int)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for match in matcher.match(second[1], first[1])}
    pairs = [
        (best.queryIdx, best.trainIdx)
        for best, other in matcher.knnMatch(first[1], second[1], k=2)
        if best.distance < _RATIO * other.distance and back.get(best.trainIdx) == best.queryIdx
    ]
    return np.array(pairs, int).reshape(-1, 2)


def _verified(first: _Features, second: _Features) -> np.ndarray:
    """(M, 4) pixels in both images of the matches that one fundamental matrix fits."""
    import cv2

    indices = _match(first, second)
    if len(indices) < LEAST_MATCHES:
        return np.zeros((0, 4))
    pixels = np.concatenate([first[0][indices[:, 0]], second[0][indices[:, 1]]], 1)
    width = max(1.0, TOLERANCE * pixels.max())
    _, inliers = cv2.findFundamentalMat(pixels[:, :2], pixels[:, 2:], cv2.USAC_MAGSAC, width, 0.999, 5000)
    return pixels[inliers.ravel() > 0] if inliers is not None else np.zeros((0, 4))


def repetition(pairs: Sequence[PairMatches]) -> float:
    """Fraction of the matches that contradict each other, whatever the cameras: followed from image to image, they lead
    to another place of an image, as on walls with a repeating pattern. Of those in three or more images."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    places: dict[tuple[str, float, float], int] = {}
    ends = []
    for pair in pairs:
        for name, pixels in ((pair.first, pair.first_pixels), (pair.second, pair.second_pixels)):
            ends.append([places.setdefault((name, x, y), len(places)) for x, y in pixels.tolist()])
    first, second = (np.array([at for ids in ends[side::2] for at in ids], int) for side in (0, 1))
    links = coo_array((np.ones(len(first)), (first, second)), shape=(len(places), len(places)))
    count, track = connected_components(links, directed=False)
    near = 2 * TOLERANCE * max((max(x, y) for _, x, y in places), default=0.0)
    seen: list[dict[str, tuple[float, float]]] = [{} for _ in range(count)]
    apart = np.zeros(count, bool)
    for (name, x, y), index in zip(places, track.tolist(), strict=True):
        other_x, other_y = seen[index].setdefault(name, (x, y))
        apart[index] |= max(abs(x - other_x), abs(y - other_y)) > near
    several = np.array([len(places_of) > 2 for places_of in seen], bool)[track[first]]
    return float(apart[track[first]][several].mean()) if several.any() else 0.0


def fitting(cameras: Mapping[str, Camera], pairs: Iterable[PairMatches]) -> dict[tuple[str, str], tuple[int, int]]:
    """Matches that fit the epipolar geometry of two cameras, and all of them, by pair of cameras."""
    off = distances(cameras, pairs)
    return {pair: (int((errors < TOLERANCE).sum()), len(errors)) for pair, errors in off.items()}


def distances(cameras: Mapping[str, Camera], pairs: Iterable[PairMatches]) -> dict[tuple[str, str], np.ndarray]:
    """(M,) distances of matches from epipolar lines by pair of cameras; fractions of the images' longer side."""
    by_pair = {}
    for pair in pairs:
        first, second = cameras[pair.first], cameras[pair.second]
        longer = max(first.width, first.height, second.width, second.height)
        apart = np.linalg.norm(first.center - second.center)
        if apart <= _CLOSE * max(np.linalg.norm(first.center), np.linalg.norm(second.center)):
            off = _turned(first, second, pair.first_pixels, pair.second_pixels)
        else:
            off = _sampson(_fundamental(first, second), pair.first_pixels, pair.second_pixels)
        by_pair[pair.first, pair.second] = off / longer
    return by_pair


def _fundamental(first: Camera, second: Camera) -> np.ndarray:
    """(3, 3) matrix F with x2' F x1 = 0."""
    motion = second.world_to_camera @ np.linalg.inv(first.world_to_camera)
    cross = np.cross(np.eye(3), motion[:3, 3])
    return np.asarray(np.linalg.inv(second.K).T @ cross @ motion[:3, :3] @ np.linalg.inv(first.K))


def _turned(first: Camera, second: Camera, pixels: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(M,) distances in pixels from where a camera that only turned sees the pixels of the first; far behind it."""
    rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(first.K).T @ first.rotation @ second.rotation.T
    there = rays @ second.K.T
    ahead = there[:, 2] > 1e-9
    there = there[:, :2] / np.where(ahead, there[:, 2], 1)[:, None]
    return np.where(ahead, np.linalg.norm(there - others, axis=1), np.inf)


def _sampson(fundamental: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(M,) Sampson distances in pixels (Hartley and Zisserman, 11.4.3)."""
    first, second = (np.c_[pixels, np.ones(len(pixels))] for pixels in (first, second))
    lines, back = first @ fundamental.T, second @ fundamental
    slopes = np.hypot(np.hypot(lines[:, 0], lines[:, 1]), np.hypot(back[:, 0], back[:, 1]))
    return np.abs((second * lines).sum(1)) / np.maximum(slopes, 1e-12)
