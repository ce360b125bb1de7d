"""Selection of the camera pairs worth matching. Runs in the worker process.

Exhaustive matching grows with the square of the number of cameras; in a rig of 81 it takes most of the time, and most
pairs see different sides of the room. Matching only the largest features first, which are the most repeatable
(preemptive matching; Wu 2013, "Towards Linear-time Incremental Structure from Motion"), takes one sixtieth of the time
and finds the pairs that overlap.
"""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

PREVIEW = 1024  # number of features per camera in the preview; the largest ones are used
FEW = 20  # with up to this many cameras, all pairs are matched, which takes about a minute
_ENOUGH = 6  # minimum number of verified preview matches that makes a pair worth matching
_AT_LEAST = 8  # each camera keeps this many of its best partners, regardless of how few matches they have


def worthwhile(
    matches: dict[tuple[int, int], int], count: int, *, enough: int = _ENOUGH, at_least: int = _AT_LEAST
) -> list[tuple[int, int]]:
    """Sorted pairs with enough matches, and the best pairs of each camera.

    Args:
        matches: number of verified matches per pair (smaller number first); pairs without any may be missing.
        enough: minimum number of matches that makes a pair worth matching.
        at_least: partners that each camera keeps, excluding those without any match.
    """
    kept = {pair for pair, number in matches.items() if number >= enough}
    for camera in range(count):
        own = [pair for pair, number in matches.items() if camera in pair and number > 0]
        kept |= set(sorted(own, key=lambda pair: (-matches[pair], pair))[:at_least])
    return sorted(kept)


def preview_pairs(
    source: Path,
    preview: Path,
    pictures: list[int],
    prepare: Callable[[Any], list[int]],
    match: Callable[[Path, list[tuple[int, int]]], None],
) -> list[tuple[int, int]]:
    """Pairs of cameras (0-based, the smaller first) worth matching, by their largest features.

    Args:
        pictures: id of one image of each camera in the source.
        prepare: writes one image per camera into the new database and returns their ids.
        match: matches and verifies pairs of cameras (0-based) in a database.
    """
    import pycolmap

    preview.unlink(missing_ok=True)
    with pycolmap.Database.open(source) as full, pycolmap.Database.open(preview) as small:
        images = prepare(small)
        for picture, image in zip(pictures, images, strict=True):
            keypoints = np.asarray(full.read_keypoints(picture))
            descriptors = full.read_descriptors(picture)
            largest = np.sort(np.argsort(-_size(keypoints), kind="stable")[:PREVIEW])
            small.write_keypoints(image, keypoints[largest])
            descriptors.data = np.asarray(descriptors.data)[largest]
            small.write_descriptors(image, descriptors)
    match(preview, list(combinations(range(len(pictures)), 2)))
    with pycolmap.Database.open(preview) as small:
        keys, counts = small.read_two_view_geometry_num_inliers()
    of = {image: camera for camera, image in enumerate(images)}
    found = {}
    for key, number in zip(keys, counts, strict=True):
        first, second = (of[image] for image in pycolmap.pair_id_to_image_pair(key))
        found[min(first, second), max(first, second)] = int(number)
    for leftover in preview.parent.glob(f"{preview.name}*"):
        leftover.unlink()
    return worthwhile(found, len(pictures))


def _size(keypoints: np.ndarray) -> np.ndarray:
    """(N,) scales of keypoints (N, 6) x, y and an affine shape, or (N, 4) x, y, scale, orientation."""
    if keypoints.shape[1] >= 6:
        return np.sqrt(np.abs(keypoints[:, 2] * keypoints[:, 5] - keypoints[:, 3] * keypoints[:, 4]))
    return keypoints[:, 2]
