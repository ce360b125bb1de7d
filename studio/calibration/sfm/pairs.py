"""Which pairs of many cameras are worth matching. Runs inside the worker's process.

Matching all features of all pairs grows with the square of the cameras: most of the time of a rig of 81 goes there, and
most pairs look at different sides of the room. A glance at the few largest features, which are the ones that are found
again from elsewhere (preemptive matching; Wu 2013, "Toward linear-time incremental structure from motion"), costs a
sixtieth and tells them apart.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

GLANCE = 1024
"""Features a camera that are looked at, the largest."""
FEW = 20
"""Up to so many cameras all pairs are matched: it takes a minute."""
_ENOUGH = 6
"""Matches in a glance that fit a common geometry."""
_AT_LEAST = 8
"""A camera keeps so many of its best partners, whatever their number of matches."""


def worthwhile(
    matches: dict[tuple[int, int], int], count: int, *, enough: int = _ENOUGH, at_least: int = _AT_LEAST
) -> list[tuple[int, int]]:
    """Pairs with enough matches, and each camera's best.

    Args:
        matches: verified matches of pairs (smaller number first); those with none may be left out.
        count: of cameras.
        enough: a pair with so many is kept.
        at_least: partners that each camera keeps, those with no match at all aside.

    Returns:
        pairs, sorted.
    """
    kept = {pair for pair, number in matches.items() if number >= enough}
    for camera in range(count):
        own = [pair for pair, number in matches.items() if camera in pair and number > 0]
        kept |= set(sorted(own, key=lambda pair: (-matches[pair], pair))[:at_least])
    return sorted(kept)


def glance(
    source: Path,
    preview: Path,
    pictures: list[int],
    prepare: Callable[[Any], list[int]],
    match: Callable[[Path, list[tuple[int, int]]], None],
) -> list[tuple[int, int]]:
    """Pairs of cameras worth matching, by their largest features.

    Args:
        source: database with keypoints and descriptors.
        preview: a database to be made, and removed at the end.
        pictures: number of one picture of each camera in the source.
        prepare: writes the cameras' images into the new database and gives their numbers there.
        match: matches and verifies pairs of cameras (0-based) in a database.

    Returns:
        pairs of cameras, 0-based, the smaller first.
    """
    import pycolmap

    preview.unlink(missing_ok=True)
    full, small = pycolmap.Database.open(source), pycolmap.Database.open(preview)
    images = prepare(small)
    for picture, image in zip(pictures, images, strict=True):
        keypoints = np.asarray(full.read_keypoints(picture))
        descriptors = full.read_descriptors(picture)
        largest = np.sort(np.argsort(-_size(keypoints), kind="stable")[:GLANCE])
        small.write_keypoints(image, keypoints[largest])
        descriptors.data = np.asarray(descriptors.data)[largest]
        small.write_descriptors(image, descriptors)
    full.close()
    small.close()
    match(preview, list(combinations(range(len(pictures)), 2)))
    small = pycolmap.Database.open(preview)
    keys, counts = small.read_two_view_geometry_num_inliers()
    small.close()
    of = {image: camera for camera, image in enumerate(images)}
    found = {}
    for key, number in zip(keys, counts, strict=True):
        first, second = (of[image] for image in pycolmap.pair_id_to_image_pair(key))
        found[min(first, second), max(first, second)] = int(number)
    for leftover in preview.parent.glob(f"{preview.name}*"):
        leftover.unlink()
    return worthwhile(found, len(pictures))


def _size(keypoints: np.ndarray) -> np.ndarray:
    """(N,) scale of (N, 6) keypoints x, y and the affine shape's four numbers; of (N, 4) with scale and angle."""
    if keypoints.shape[1] >= 6:
        return np.sqrt(np.abs(keypoints[:, 2] * keypoints[:, 5] - keypoints[:, 3] * keypoints[:, 4]))
    return keypoints[:, 2]
