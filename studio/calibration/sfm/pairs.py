"""Selection of the camera pairs worth matching. Runs in the worker process.

Exhaustive matching grows with the square of the number of cameras; in a rig of 81 it takes most of the time, and most
pairs see different sides of the room. Matching only the largest features first, which are the most repeatable
(preemptive matching; Wu 2013, "Towards Linear-time Incremental Structure from Motion"), takes one sixtieth of the time
and finds the pairs that overlap.
"""

import numpy as np

PREVIEW = 1024  # number of features per camera in the preview; the largest ones are used
FEW = 20  # with up to this many cameras, all pairs are matched, which takes about a minute
_ENOUGH = 6  # minimum number of verified preview matches that makes a pair worth matching
_AT_LEAST = 8  # each camera keeps this many of its best partners, regardless of how few matches they have


def worthwhile(matches: dict[tuple[int, int], int], count: int) -> list[tuple[int, int]]:
    """Sorted pairs with enough matches, and the best pairs with any of each of `count` cameras. `matches`: number of
    verified matches per pair (smaller number first); pairs without any may be missing."""
    kept = {pair for pair, number in matches.items() if number >= _ENOUGH}
    for camera in range(count):
        own = [pair for pair, number in matches.items() if camera in pair and number > 0]
        kept |= set(sorted(own, key=lambda pair: (-matches[pair], pair))[:_AT_LEAST])
    return sorted(kept)


def largest(keypoints: np.ndarray) -> np.ndarray:
    """Sorted indices of the `PREVIEW` largest keypoints (N, 6) x, y and an affine shape, or (N, 4) x, y, scale,
    orientation."""
    scales = keypoints[:, 2]
    if keypoints.shape[1] >= 6:
        scales = np.sqrt(np.abs(keypoints[:, 2] * keypoints[:, 5] - keypoints[:, 3] * keypoints[:, 4]))
    return np.sort(np.argsort(-scales, kind="stable")[:PREVIEW])
