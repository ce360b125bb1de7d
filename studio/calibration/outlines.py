"""Finds where planes through two cameras touch the outlines of a performer: evidence on cameras, masks and time.

A plane that contains the centers of two cameras and touches the performer touches both of their silhouettes (frontier
points: Cipolla, Astrom and Giblin 1995). This needs no matches, so it also judges cameras that are far apart, and it
moves with the performer, so it tells when images were taken (Sinha and Pollefeys 2004).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from v3studio.studio.cameras import Camera, nearest_point_to_rays

TOUCHES = 0.005
"""Distance between two tangents that count as the same, as a fraction of the longer side: 3 pixels of 640."""
_SMALLEST = 0.1  # areas of a mask below this share of its largest one are not the performer
_BORDER = 2  # pixels: what touches the image's border goes on outside
_ALONG = (
    0.94  # cosine between the line through two cameras and the view from one of them, beyond which planes tell little
)
_CLOSE = 0.02  # of the distance from what they look at: cameras that are nearer to each other tell nothing
_WIDEST = 2.8  # radians: what spans more surrounds the line through both cameras
_EVERY_PAIR = 12  # cameras of which all pairs are compared; of more, each with those some places further
_PLACES = (1, 2, 3, 5, 8)


def outline(mask: np.ndarray) -> np.ndarray:
    """(N, 2) float64 corners of the convex hull of a mask (H, W) uint8, without its small areas; in pixels."""
    inside = (mask > 127).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(inside)
    areas = stats[:, cv2.CC_STAT_AREA] * (np.arange(len(stats)) > 0)
    if not areas.any():
        return np.zeros((0, 2))
    kept = (areas >= _SMALLEST * areas.max())[labels].astype(np.uint8)
    edges = np.concatenate(cv2.findContours(kept, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0])
    return np.asarray(cv2.convexHull(edges)[:, 0], np.float64) + 0.5


@dataclass(frozen=True, eq=False)
class Outlines:
    """Outlines of a rig's masks: `hulls` has as many by camera as frames, each as `outline` gives it."""

    hulls: Mapping[str, Sequence[np.ndarray]]

    def pairs(self) -> Iterator[tuple[str, str]]:
        """The pairs of cameras that are compared."""
        names = list(self.hulls)
        if len(names) <= _EVERY_PAIR:
            yield from combinations(names, 2)
            return
        for place, name in enumerate(names):
            yield from ((name, names[(place + step) % len(names)]) for step in _PLACES)

    def moved(self) -> "Outlines":
        """The frames in which the outlines are not where they were in the frames before: a performer who keeps still is
        evidence once."""
        count = min(len(hulls) for hulls in self.hulls.values())
        kept = [0]
        for frame in range(1, count):
            steps = [_step(hulls[kept[-1]], hulls[frame]) for hulls in self.hulls.values()]
            if np.median(steps) > TOUCHES:
                kept.append(frame)
        return Outlines({name: [hulls[frame] for frame in kept] for name, hulls in self.hulls.items()})

    def heights(self, cameras: Mapping[str, Camera]) -> dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]:
        """By pair of cameras, for each of both, (frames, 2) places of the lowest and the highest plane through both
        cameras that touches its outline, as fractions of the longer side; NaN where the image ends before."""
        shapes = {name: _Shape(cameras[name], hulls) for name, hulls in self.hulls.items()}
        axes = [cameras[name] for name in shapes]
        focus = nearest_point_to_rays(np.array([c.center for c in axes]), np.array([c.forward for c in axes]))
        found = {}
        for pair in self.pairs():
            first, second = (cameras[name] for name in pair)
            along, views = second.center - first.center, [focus - first.center, focus - second.center]
            away = [float(np.linalg.norm(view)) for view in views]
            apart = float(np.linalg.norm(along))
            if apart < _CLOSE * max(away):
                continue
            along /= apart
            if min(away) < 1e-9 or any(abs(view @ along) > _ALONG * d for view, d in zip(views, away, strict=True)):
                continue
            toward = views[0] - along * (views[0] @ along)
            reach = float(np.linalg.norm(toward))
            plane = np.stack([toward / reach, np.cross(along, toward / reach)])
            scale = reach / np.mean(away) * (first.fx + second.fx) / 2 / max(first.width, first.height)
            found[pair] = (scale * shapes[pair[0]].tangents(plane), scale * shapes[pair[1]].tangents(plane))
        return found

    def fitting(self, cameras: Mapping[str, Camera]) -> dict[tuple[str, str], tuple[int, int]]:
        """Tangents that both cameras of a pair have at the same place, and all of them, by pair."""
        counts = {}
        for pair, (first, second) in self.heights(cameras).items():
            off, size = np.abs(first - second), (cameras[pair[0]].width, cameras[pair[0]].height)
            same = off < max(TOUCHES, 1 / max(size))  # at least a pixel
            counts[pair] = (int(same.sum()), int(np.isfinite(off).sum()))
        return counts


class _Shape:
    """Rays, in world axes, through the corners of a camera's outlines."""

    def __init__(self, camera: Camera, hulls: Sequence[np.ndarray]) -> None:
        middle = np.array([[camera.cx, camera.cy]])
        pixels = np.concatenate([hull if len(hull) else middle for hull in hulls])
        self._starts = np.cumsum([0, *(max(len(hull), 1) for hull in hulls[:-1])])
        self._rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(camera.K).T @ camera.rotation
        self._ends = ((pixels < _BORDER) | (pixels > np.array([camera.width, camera.height]) - _BORDER)).any(1)
        self._empty = np.array([len(hull) < 3 for hull in hulls])

    def tangents(self, plane: np.ndarray) -> np.ndarray:
        """(frames, 2) lowest and highest angle of the rays around the line through two cameras, in radians from the
        first of two directions (2, 3) across it."""
        angles = np.arctan2(self._rays @ plane[1], self._rays @ plane[0])
        sides = []
        for sign in (1, -1):
            lowest = np.minimum.reduceat(sign * angles, self._starts)
            whole = np.minimum.reduceat(np.where(self._ends, np.inf, sign * angles), self._starts)
            sides.append(sign * np.where(lowest == whole, lowest, np.nan))
        both = np.stack(sides, 1)
        both[self._empty | (np.nan_to_num(both[:, 1] - both[:, 0]) > _WIDEST)] = np.nan
        return both


def _step(before: np.ndarray, after: np.ndarray) -> float:
    """Return how far an outline's box moved, as a fraction of the box."""
    if not len(before) or not len(after):
        return float(len(before) != len(after))
    boxes = [np.concatenate([hull.min(0), hull.max(0)]) for hull in (before, after)]
    return float(np.abs(boxes[1] - boxes[0]).max() / max(np.ptp(before, axis=0).max(), 1.0))
