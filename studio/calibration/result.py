"""The result of a calibration, and its reprojection report."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from v3studio.studio.calibration.report import (
    CalibrationReport,
    CameraReport,
    ErrorStatistics,
    Neighbor,
    RigGeometry,
)
from v3studio.studio.cameras import Rig
from v3studio.studio.counts import short_repr


@dataclass
class CalibrationResult:
    """Registered cameras in the order of the given images; (P, 3) float64 sparse points, world coordinates, and their
    (P, 3) uint8 RGB; quality of the solution."""

    rig: Rig
    points: np.ndarray
    colors: np.ndarray
    report: CalibrationReport

    __repr__ = short_repr


def image_coverage(pixels: np.ndarray, size: tuple[int, int]) -> float:
    """Fraction of a 4x4 grid over an image of (width, height) with at least one of the pixels (N, 2)."""
    if len(pixels) == 0:
        return 0.0
    return np.count_nonzero(_counts(pixels, size, 4)) / 16


def error_statistics(errors: np.ndarray) -> ErrorStatistics:
    """Statistics of reprojection errors (N,) in pixels, rounded to 1e-4; zeros if there are none."""
    if len(errors) == 0:
        return ErrorStatistics(mean=0.0, median=0.0, p95=0.0)
    return ErrorStatistics(
        mean=round(float(errors.mean()), 4),
        median=round(float(np.median(errors)), 4),
        p95=round(float(np.quantile(errors, 0.95)), 4),
    )


def reprojection_report(
    rig: Rig, points: np.ndarray, observations: dict[str, np.ndarray], **more: Any
) -> CalibrationReport:
    """Reprojection errors of (P, 3) points in world coordinates, measured with `Camera.project`. `observations`: camera
    name to (M, 3): index of the point, column and row of each observation in pixels; `more`: other fields."""
    every: list[np.ndarray] = []
    cameras: dict[str, CameraReport] = {}
    tracks = np.zeros(len(points), np.int64)
    for camera in rig:
        seen = observations.get(camera.name, np.zeros((0, 3)))
        size = (camera.width, camera.height)
        index = seen[:, 0].astype(int)
        pixels, _ = camera.project(points[index])
        errors = np.linalg.norm(pixels - seen[:, 1:], axis=1)
        every.append(errors)
        tracks += np.bincount(index, minlength=len(points))
        cameras[camera.name] = CameraReport(
            **error_statistics(errors).model_dump(),
            observations=len(errors),
            coverage=round(image_coverage(seen[:, 1:], size), 3),
            coverage_map=_counts(seen[:, 1:], size, 8).tolist(),
            focal=round(camera.fx, 2),
        )
    errors = np.concatenate(every) if every else np.zeros(0)
    return CalibrationReport(
        reprojection=error_statistics(errors),
        points=len(points),
        observations=len(errors),
        mean_track_length=round(float(tracks[tracks > 0].mean()), 3) if (tracks > 0).any() else 0.0,
        tracks={str(length): int(count) for length, count in enumerate(np.bincount(tracks)) if length and count},
        geometry=_rig_geometry(rig, _triangulation_angle(rig, points, observations)),
        cameras=cameras,
        **more,
    )


def _rig_geometry(rig: Rig, triangulation_angle: float) -> RigGeometry:
    """Distances and angles between the cameras of a rig."""
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
        nearest[camera.name] = Neighbor(
            name=rig.names[other],
            distance=round(float(distances[other]), 6),
            angle=round(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))), 2),
        )
    radius = round(float(lengths.mean()), 6)
    return RigGeometry(radius=radius, neighbors=nearest, triangulation_angle=triangulation_angle)


def _triangulation_angle(rig: Rig, points: np.ndarray, observations: dict[str, np.ndarray]) -> float:
    """Median over the points of the widest angle in degrees between the ray of the first camera that observes it and
    any later one."""
    if not len(points):
        return 0.0
    first, cosine = np.full((len(points), 3), np.nan), np.ones(len(points))
    for camera in rig:
        index = np.unique(observations.get(camera.name, np.zeros((0, 3)))[:, 0].astype(int))
        rays = camera.center - points[index]
        rays = rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
        new = np.isnan(first[index, 0])
        first[index[new]] = rays[new]
        old = index[~new]
        cosine[old] = np.minimum(cosine[old], (first[old] * rays[~new]).sum(1))
    return round(float(np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1)))), 2)


def _counts(pixels: np.ndarray, size: tuple[int, int], cells: int) -> np.ndarray:
    """(cells, cells) int: number of pixels in each cell of a grid over the image."""
    rows, columns = (np.clip(pixels[:, axis] / size[axis] * cells, 0, cells - 1).astype(int) for axis in (1, 0))
    return np.bincount(rows * cells + columns, minlength=cells**2).reshape(cells, cells)
