"""Cameras vote on voxels: what the other cameras say about each pixel of an image.

A voxel's score is the smooth minimum of the log-odds at its projections, so that a few cameras that say "set" outweigh
many, as in a visual hull, but a single one does not (compare Franco and Boyer, "Fusion of Multi-View Silhouette Cues
Using a Space Occupancy Grid", ICCV 2005). A camera does not vote on what is outside of its image.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from v3studio.studio.cameras import Camera, Rig

SILENT = -2.0
"""The votes that pixels hear behind which there is no voxel that could belong to the performer."""
_LIMIT = 2.0
"""Log-odds of one camera's vote are clipped to this."""
_REACH = 0.85
"""Half of the volume's side, in mean distances of the cameras from the point at which they look."""
CELLS = 48
"""Cells along each side at first."""
_PIXELS = 4.0
"""Cells are split until they cover about so many pixels."""
_FLOOR = -0.5
"""Voxels with a lower score belong to no performer."""
_SLACK = (0.6, 0.3)
"""Difference by which the score may be lower in cells that are split again: at first, and later."""
_MOST_VOXELS = 400_000
_FEWEST_VIEWS = 0.2
"""Share of the voters that must see a voxel; at least 3 must."""
_LEVELS = 6  # of the image pyramids


def heard(
    odds: Mapping[str, np.ndarray],
    cameras: Mapping[str, Camera],
    voters: frozenset[str],
    each: Callable[..., Iterable[Any]] = map,
) -> dict[str, np.ndarray]:
    """The best score that other cameras give a voxel behind each pixel: (H, W) float32 from `SILENT` to 2, by camera.
    `each`: as `map`, for several cameras at a time."""
    voting = [name for name in odds if name in voters]
    pyramids = {name: _pyramid(np.clip(odds[name], -_LIMIT, _LIMIT)) for name in odds}
    least = max(3, round(_FEWEST_VIEWS * len(voting)))
    rig = Rig(tuple(cameras[name] for name in voting))
    distance = float(np.linalg.norm(rig.centers - rig.focus, axis=1).mean())
    half = _REACH * distance
    size = 2 * half / CELLS
    focal = float(np.median([camera.fx for camera in rig]))
    splits = int(np.clip(np.round(np.log2(size * focal / distance / _PIXELS)), 0, 4))
    steps = (np.arange(CELLS) + 0.5) * size - half
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3) + rig.focus
    points = points.astype(np.float32)
    for level in range(splits + 1):
        cast = each(lambda name: _vote(pyramids[name], cameras[name], points, size), voting)  # noqa: B023
        votes = dict(zip(voting, cast, strict=True))
        total, views = np.zeros(len(points), np.float32), np.zeros(len(points), np.int64)
        for against, seen in votes.values():
            total += against
            views += seen
        score = np.where(views >= least, -np.log(np.maximum(total / np.maximum(views, 1), 1e-6)), -np.inf)
        slack = 0.0 if level == splits else _SLACK[min(level, 1)]
        keep = score > _FLOOR - slack
        if keep.sum() > _MOST_VOXELS:
            keep = score >= np.partition(score, -_MOST_VOXELS)[-_MOST_VOXELS]
        points, total, views = points[keep], total[keep], views[keep]
        if level < splits:
            corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 4
            points = (points[:, None] + corners.astype(np.float32)).reshape(-1, 3)
            size /= 2

    def shown(name: str) -> np.ndarray:
        others, count = total, views
        if name in voters:
            against, seen = votes[name]
            others, count = total - against[keep], views - seen[keep]
        score = -np.log(np.maximum(others / np.maximum(count, 1), np.exp(-_LIMIT)))
        return _shown(cameras[name], points, size, score.astype(np.float32), odds[name].shape)

    return dict(zip(cameras, each(shown, list(cameras)), strict=True))


def _pyramid(odds: np.ndarray) -> list[np.ndarray]:
    """The map at half, a quarter, ... of its size."""
    import cv2

    levels = [odds]
    for level in range(1, _LEVELS):
        size = (max(1, -(-odds.shape[1] // 2**level)), max(1, -(-odds.shape[0] // 2**level)))
        levels.append(cv2.resize(odds, size, interpolation=cv2.INTER_AREA))
    return levels


def _vote(pyramid: list[np.ndarray], camera: Camera, points: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Votes of a camera on cubes of edge `size` around the points (N, 3): odds against the performer (N,), and whether
    it sees them (N,) bool."""
    height, width = pyramid[0].shape
    u, v, depth = _project(camera, points)
    seen = (depth > 0) & (u >= 0) & (v >= 0) & (u < width) & (v < height)
    against = np.zeros(len(points), np.float32)
    index = np.flatnonzero(seen)
    u, v = u[index], v[index]
    cover = np.maximum(size * camera.fx / depth[index], 1.0)
    levels = np.minimum(np.round(np.log2(cover)), _LEVELS - 1).astype(np.int8)
    for level in range(int(levels.min(initial=0)), int(levels.max(initial=-1)) + 1):
        chosen = levels == level
        there = index[chosen]
        smaller = pyramid[level]
        column, row = (u[chosen] / 2**level).astype(np.intp), (v[chosen] / 2**level).astype(np.intp)
        inside = smaller[np.minimum(row, smaller.shape[0] - 1), np.minimum(column, smaller.shape[1] - 1)]
        against[there] = np.exp(-inside)
    return against, seen


def _project(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, rows and depths of points (N, 3) float32; as `Camera.project`, which is slower without distortion."""
    if not camera.is_pinhole:
        pixels, depth = camera.project(points)
        with np.errstate(over="ignore"):  # far outside of the image, the distortion has no limit
            return pixels[:, 0].astype(np.float32), pixels[:, 1].astype(np.float32), depth.astype(np.float32)
    matrix = (camera.K @ camera.world_to_camera[:3]).astype(np.float32)
    x, y, depth = matrix[:, :3] @ points.T + matrix[:, 3:]
    safe = np.where(depth > 0, depth, np.float32(1))
    return x / safe, y / safe, depth


def _shown(camera: Camera, points: np.ndarray, size: float, score: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(H, W) float32: the highest score of the voxels that cover each pixel."""
    import cv2

    result = np.full(shape, SILENT, np.float32)
    u, v, depth = _project(camera, points)
    radius = np.ceil(0.5 * size * camera.fx / np.maximum(depth, 1e-6))
    margin = int(np.clip(radius[depth > 0].max(initial=0), 0, 40))
    near = (depth > 0) & (u >= -margin) & (v >= -margin) & (u < shape[1] + margin) & (v < shape[0] + margin)
    radius = np.clip(radius, 1, margin)
    for reach in np.unique(radius[near]).astype(int):
        there = np.flatnonzero(near & (radius == reach))
        single = np.full((shape[0] + 2 * margin, shape[1] + 2 * margin), SILENT, np.float32)
        np.maximum.at(single, ((v[there] + margin).astype(int), (u[there] + margin).astype(int)), score[there])
        grown = cv2.dilate(single, np.ones((2 * reach - 1, 2 * reach - 1), np.uint8))
        np.maximum(result, grown[margin : margin + shape[0], margin : margin + shape[1]], out=result)
    return result
