"""What a calibration gives, and figures of how good it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from studio.cameras import Rig


@dataclass
class CalibrationResult:
    """Cameras and sparse points.

    Attributes:
        rig: the registered cameras, in the order of the images given.
        points: (P, 3) float64 world coordinates of the sparse points.
        colors: (P, 3) uint8 RGB.
        report: JSON-ready figures, see `reprojection_report`, with `unregistered` (name to reason), `mapper`,
            `features` and `matches` a camera, and `seconds`.
    """

    rig: Rig
    points: np.ndarray
    colors: np.ndarray
    report: dict[str, Any]


def band(error: float) -> str:
    """The words people use for a mean reprojection error in pixels."""
    return "excellent" if error < 0.5 else "acceptable" if error < 1.0 else "review"


def image_coverage(pixels: np.ndarray, size: tuple[int, int], cells: int = 4) -> float:
    """Share of a grid of `cells` x `cells` over an image that holds at least one of the pixels (N, 2)."""
    if len(pixels) == 0:
        return 0.0
    column, row = (np.clip(pixels[:, axis] / size[axis] * cells, 0, cells - 1).astype(int) for axis in (0, 1))
    return len(np.unique(column * cells + row)) / cells**2


def _figures(errors: np.ndarray) -> dict[str, float]:
    if len(errors) == 0:
        return {"mean": 0.0, "median": 0.0, "p95": 0.0}
    return {
        "mean": round(float(errors.mean()), 4),
        "median": round(float(np.median(errors)), 4),
        "p95": round(float(np.quantile(errors, 0.95)), 4),
    }


def reprojection_report(rig: Rig, points: np.ndarray, observations: dict[str, np.ndarray]) -> dict[str, Any]:
    """Reprojection errors, measured with our own cameras.

    Args:
        rig: the cameras.
        points: (P, 3).
        observations: camera name to (M, 3): index of the point, column and row where it was seen, pixels.

    Returns:
        `reprojection` {mean, median, p95} in pixels over all observations, `quality` in words, `points`,
        `observations`, `mean_track_length`, `tracks` (how many points are seen by 2, 3 ... cameras, as text keys),
        `geometry` (see `rig_geometry`) with `triangulation_angle`, the median over the points of the widest angle
        between two of their rays in degrees, and `cameras`: the same figures, `quality`, the number of observations,
        the focal length, the share of a 4x4 grid of the image that observations cover, and `coverage_map`, the numbers
        of observations in each cell of an 8x8 grid, row by row, a camera each.
    """
    every: list[np.ndarray] = []
    cameras: dict[str, Any] = {}
    tracks = np.zeros(len(points), np.int64)
    widest = _WidestAngles(points)
    for camera in rig:
        seen = observations.get(camera.name, np.zeros((0, 3)))
        index = seen[:, 0].astype(int)
        pixels, _ = camera.project(points[index])
        errors = np.linalg.norm(pixels - seen[:, 1:], axis=1)
        every.append(errors)
        tracks += np.bincount(index, minlength=len(points))
        widest.add(np.unique(index), camera.center)
        cameras[camera.name] = {
            **_figures(errors),
            "quality": band(float(errors.mean())) if len(errors) else "review",
            "observations": len(errors),
            "coverage": round(image_coverage(seen[:, 1:], (camera.width, camera.height)), 3),
            "coverage_map": _coverage_map(seen[:, 1:], (camera.width, camera.height)),
            "focal": round(camera.fx, 2),
            "distortion": [round(float(value), 6) for value in camera.distortion],
        }
    errors = np.concatenate(every) if every else np.zeros(0)
    figures = _figures(errors)
    return {
        "reprojection": figures,
        "quality": band(figures["mean"]),
        "points": len(points),
        "observations": len(errors),
        "mean_track_length": round(float(tracks[tracks > 0].mean()), 3) if (tracks > 0).any() else 0.0,
        "tracks": {str(length): int(count) for length, count in enumerate(np.bincount(tracks)) if length and count},
        "geometry": {**rig_geometry(rig), "triangulation_angle": widest.median()},
        "cameras": cameras,
    }


def rig_geometry(rig: Rig) -> dict[str, Any]:
    """How the cameras stand to each other.

    Returns:
        `radius`, the mean distance of the cameras from the point they look at, and `neighbors`: of each camera the
        nearest other one, the distance to it, and the angle in degrees between them as seen from that point.
    """
    focus, centers = rig.focus, rig.centers
    rays = centers - focus
    lengths = np.maximum(np.linalg.norm(rays, axis=1), 1e-12)
    nearest = {}
    for index, camera in enumerate(rig):
        distances = np.linalg.norm(centers - camera.center, axis=1)
        distances[index] = np.inf
        if len(rig) < 2:
            break
        other = int(np.argmin(distances))
        cosine = float(rays[index] @ rays[other] / lengths[index] / lengths[other])
        nearest[camera.name] = {
            "name": rig.names[other],
            "distance": round(float(distances[other]), 6),
            "angle": round(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))), 2),
        }
    return {"radius": round(float(lengths.mean()), 6), "neighbors": nearest}


class _WidestAngles:
    """Of each point the widest angle between two rays, to the first camera that saw it and the later ones."""

    def __init__(self, points: np.ndarray) -> None:
        self.points = points
        self.first = np.full((len(points), 3), np.nan)
        self.cosine = np.ones(len(points))

    def add(self, index: np.ndarray, center: np.ndarray) -> None:
        """A camera at `center` sees the points of `index`."""
        rays = center - self.points[index]
        rays = rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
        new = np.isnan(self.first[index, 0])
        self.first[index[new]] = rays[new]
        old = index[~new]
        self.cosine[old] = np.minimum(self.cosine[old], (self.first[old] * rays[~new]).sum(1))

    def median(self) -> float:
        """Degrees."""
        if len(self.points) == 0:
            return 0.0
        return round(float(np.degrees(np.arccos(np.clip(np.median(self.cosine), -1, 1)))), 2)


def _coverage_map(pixels: np.ndarray, size: tuple[int, int], cells: int = 8) -> list[list[int]]:
    """Observations in each cell of a grid over the image."""
    rows, columns = (np.clip(pixels[:, axis] / size[axis] * cells, 0, cells - 1).astype(int) for axis in (1, 0))
    counts = np.bincount(rows * cells + columns, minlength=cells * cells)
    grid: list[list[int]] = counts.reshape(cells, cells).tolist()
    return grid
