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
        `observations`, `mean_track_length`, and `cameras`: the same figures, the number of observations, the focal
        length and the share of a 4x4 grid of the image that observations cover, a camera each.
    """
    every: list[np.ndarray] = []
    cameras: dict[str, Any] = {}
    tracks = np.zeros(len(points), np.int64)
    for camera in rig:
        seen = observations.get(camera.name, np.zeros((0, 3)))
        index = seen[:, 0].astype(int)
        pixels, _ = camera.project(points[index])
        errors = np.linalg.norm(pixels - seen[:, 1:], axis=1)
        every.append(errors)
        tracks += np.bincount(index, minlength=len(points))
        column = np.clip(seen[:, 1] / camera.width * 4, 0, 3).astype(int)
        row = np.clip(seen[:, 2] / camera.height * 4, 0, 3).astype(int)
        cameras[camera.name] = {
            **_figures(errors),
            "observations": len(errors),
            "coverage": round(len(set(zip(column.tolist(), row.tolist(), strict=True))) / 16, 3),
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
        "cameras": cameras,
    }
