"""Points on the set that stands behind a performer, from the images of it alone: a plane sweep in each camera.

A depth is likely where the neighbors' images, warped by the plane at that depth, correlate with the camera's. Walls
without texture correlate with everything, so costs are aggregated along scan lines, as in semi-global matching (H.
Hirschmueller, 2008), which carries depths from edges across walls and floors. Other cameras confirm depths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.masks.filters import reduced
from v3studio.studio.progress import ProgressFn, no_progress

_SIDE = 240
"""Longest side of the images in which depths are searched."""
_DEPTHS = 128
_NEIGHBORS = 4
_WINDOW, _SLOPES = 7, 3.0  # pixels
_NEAREST, _FARTHEST = 0.2, 8.0
"""Depths that are searched, in distances from the camera to the middle of what the rig looks at."""
_STEP, _JUMP = 0.01, 0.5
"""Costs of a change of depth along a scan line, by one and by more depths: floors are seen at a slant."""
_AIR = 0.1
"""Cost of the nearest depth, from which it falls to 0 at the farthest: without evidence, nothing is in the air."""
_AGREES = 0.06
"""Relative difference of depths up to which two cameras agree."""


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depths (h, w) float32, world units along the camera's axis, at reduced size; `sure`: (h, w) bool, another camera
    agrees."""

    camera: Camera
    depth: np.ndarray
    sure: np.ndarray


def looked_at(cameras: Sequence[Camera]) -> np.ndarray:
    """The (3,) point nearest to the axes of the cameras, world units."""
    left = [np.eye(3) - np.outer(camera.forward, camera.forward) for camera in cameras]
    right = [matrix @ camera.center for matrix, camera in zip(left, cameras, strict=True)]
    return np.linalg.lstsq(np.sum(left, 0) + 1e-9 * np.eye(3), np.sum(right, 0), rcond=None)[0]


def depth_maps(
    plates: Mapping[str, np.ndarray], cameras: Sequence[Camera], progress: ProgressFn = no_progress
) -> list[DepthMap]:
    """Return the depths of the set in each camera; `plates`: by camera, as `FootageView.plate`."""
    import cv2

    middle = looked_at(cameras)
    least = float(np.std([camera.center for camera in cameras], axis=0).max())  # for cameras side by side
    small, grays = [], []
    for camera in cameras:
        image = reduced(plates[camera.name], _SIDE)
        small.append(camera.resized(image.shape[1], image.shape[0]))
        gray = image[..., :3].astype(np.float32).mean(2)
        # without slopes of light, which correlate wherever they are
        grays.append(gray - cv2.GaussianBlur(gray, (0, 0), _SLOPES) + 256)
    depths = []
    neighbors = [_neighbors(small, index, middle) for index in range(len(small))]
    for index, camera in enumerate(small):
        progress(index, len(small))
        far = max(float((middle - camera.center) @ camera.forward), least, 1e-6)
        inverse = np.linspace(1 / (_NEAREST * far), 1 / (_FARTHEST * far), _DEPTHS, dtype=np.float32)
        others = [(small[other], grays[other]) for other in neighbors[index]]
        cost = _sweep(camera, grays[index], others, 1 / inverse)
        cost += (_AIR * np.linspace(1, 0, _DEPTHS, dtype=np.float32))[:, None, None]
        depths.append(1 / inverse[_aggregated(cost).argmin(0)])
    return [
        DepthMap(camera, depth, _agreed(small, depths, index, neighbors[index]))
        for index, (camera, depth) in enumerate(zip(small, depths, strict=True))
    ]


def _neighbors(cameras: Sequence[Camera], index: int, middle: np.ndarray) -> list[int]:
    """The cameras that see most nearly the same from another place."""
    own = cameras[index]
    near = []
    for other, camera in enumerate(cameras):
        if other != index:
            rays = [(middle - each.center) / np.linalg.norm(middle - each.center) for each in (own, camera)]
            near.append((-float(rays[0] @ rays[1]), other))
    return [other for _, other in sorted(near)[:_NEIGHBORS]]


def _sweep(
    camera: Camera, gray: np.ndarray, others: Sequence[tuple[Camera, np.ndarray]], depths: np.ndarray
) -> np.ndarray:
    """(D, h, w) float32 costs of depths, 0 to 1: one minus the correlation with the better half of the others."""
    import cv2

    def mean(image: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.blur(image, (_WINDOW, _WINDOW)))

    height, width = gray.shape
    own = mean(gray)
    spread = mean(gray * gray) - own * own
    costs = np.ones((len(depths), height, width), np.float32)
    for number, depth in enumerate(depths):
        scores = []
        for other, image in others:
            turn = other.rotation @ camera.rotation.T
            shift = other.translation - turn @ camera.translation
            plane = turn + np.outer(shift, [0, 0, 1]) / depth
            warp = other.cv2_K @ plane @ np.linalg.inv(camera.cv2_K)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            seen = cv2.warpPerspective(image, warp, (width, height), flags=flags, borderValue=-1)
            theirs = mean(seen)
            joint = mean(seen * gray) - theirs * own
            norm = np.sqrt(np.maximum(spread, 4.0) * np.maximum(mean(seen * seen) - theirs * theirs, 4.0))
            scores.append(np.where(seen >= 0, 1 - joint / norm, 1.0))
        best = np.sort(np.stack(scores), 0)[: max(1, len(scores) // 2)]
        costs[number] = best.mean(0)
    return costs


def _aggregated(cost: np.ndarray) -> np.ndarray:
    """(D, h, w) costs, summed along scan lines in four directions."""
    total = np.zeros_like(cost)
    for axis in (1, 2):
        lines = np.moveaxis(cost, axis, 0)
        sums = np.moveaxis(total, axis, 0)
        for order in (range(len(lines)), range(len(lines) - 1, -1, -1)):
            before: np.ndarray | None = None
            for line in order:
                now = lines[line]
                if before is not None:
                    least = before.min(0)
                    moved = np.minimum(before, least + _JUMP)
                    moved[1:] = np.minimum(moved[1:], before[:-1] + _STEP)
                    moved[:-1] = np.minimum(moved[:-1], before[1:] + _STEP)
                    now = now + moved - least
                sums[line] += now
                before = now
    return total


def _agreed(cameras: Sequence[Camera], depths: Sequence[np.ndarray], index: int, others: Sequence[int]) -> np.ndarray:
    """(h, w) bool: another camera has nearly the same depth there."""
    points = unprojected(cameras[index], depths[index])
    sure = np.zeros(depths[index].shape, bool)
    for other in others:
        pixels, z = cameras[other].project(points.reshape(-1, 3))
        column, row = (np.floor(np.nan_to_num(pixels, nan=-1.0, posinf=-1, neginf=-1)).clip(-1, 1e6).astype(int)).T
        height, width = depths[other].shape
        inside = (z > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        theirs = depths[other][row.clip(0, height - 1), column.clip(0, width - 1)]
        sure |= (inside & (abs(theirs - z) < _AGREES * z)).reshape(sure.shape)
    return sure


def unprojected(camera: Camera, depth: np.ndarray) -> np.ndarray:
    """(h, w, 3) world points at depths (h, w) along the axis of a camera of that size."""
    rows, columns = np.indices(depth.shape)
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones(depth.shape)], -1) @ np.linalg.inv(camera.K).T
    return (rays * depth[..., None] - camera.translation) @ camera.rotation
