"""How surely the marks say where each camera stands: a small error tells nothing where points lie on a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from studio.calibration.manual.bootstrap import Observations, TieRig
from studio.calibration.manual.bundle_adjustment import Accuracy, Problem

_STEP = 1e-6
_FREE = 7
_WEAKEST = 1e-12


def spread_of_positions(places: np.ndarray) -> int:
    """How many directions points (N, 3) spread into: 0 for one place, 1 for a line, 2 for a plane and more."""
    if len(places) < 2:
        return 0
    spread = np.linalg.svd(places - places.mean(0), compute_uv=False)
    if spread[0] < 1e-9:
        return 0
    return 1 if len(spread) < 2 or spread[1] <= 1e-3 * spread[0] else 2


def contradiction(rig: TieRig, observations: Observations) -> str:
    """What is wrong where an adjustment ended nowhere, points behind the cameras or all in one place; else ""."""
    errors = np.concatenate(list(rig.errors(observations).values()))
    behind = float(np.isinf(errors[~np.isnan(errors)]).mean()) > 0.3
    which = observations.measured & rig.placed
    smaller = which.sum() > 1 and np.linalg.norm(np.ptp(rig.places[which], 0)) < 0.2 * np.linalg.norm(
        np.ptp(observations.world[which], 0)
    )
    if smaller or (behind and which.any()):
        return "The measured places contradict the marks: one is wrong, or their axes are not right-handed with z up."
    return "The marks fit no cameras: the points would lie behind them; look at the marks again." if behind else ""


def uncertainty(
    rig: TieRig, observations: Observations, groups: Sequence[Sequence[str]], accuracy: Accuracy, *, radial: bool = True
) -> dict[str, float]:
    """Standard deviation of each camera's center, as a share of the cameras' mean distance from the points.

    From the adjustment's derivatives at its end. It is what the cameras may be off beside each other: where all of them
    lie in the world, and how large the world is, does not count.

    Args:
        rig: adjusted.
        observations, groups, accuracy, radial: as in `adjust`.
    """
    problem = Problem(rig, observations, groups, accuracy, radial)
    marks = Problem(
        rig, replace(observations, world=np.full_like(observations.world, np.nan)), groups, accuracy, radial
    )
    values = problem.start()
    places = rig.places[problem.placed]
    size = float(np.mean([np.linalg.norm(places - c.center, axis=1).mean() for c in rig.cameras.values()]))
    units = np.ones(len(values))
    for number in range(len(problem.names)):
        units[6 * number + 3 : 6 * number + 6] = size
    units[problem.first_point :] = size
    of_marks, of_all = (each.jacobian(values) * units for each in (marks, problem))
    # the seven directions that marks say nothing of: the world's place, its directions and its size
    nothing = np.linalg.eigh(of_marks.T @ of_marks)[1][:, :_FREE]
    strengths, directions = np.linalg.eigh(of_all.T @ of_all + nothing @ nothing.T)
    roots = directions / np.sqrt(np.maximum(strengths, _WEAKEST))
    roots = roots - nothing @ (nothing.T @ roots)
    residuals = marks.residuals(values)
    beyond = len(residuals) - len(values) + _FREE
    noise = max(1.0, float(np.sqrt((residuals**2).sum() / beyond))) if beyond > 0 else 1.0
    found = {}
    for number, name in enumerate(problem.names):
        own = slice(6 * number, 6 * number + 6)
        found[name] = noise * float(np.linalg.norm(_center_slopes(values[own]) * units[own] @ roots[own])) / size
    return found


def _center_slopes(pose: np.ndarray) -> np.ndarray:
    """(3, 6) derivatives of a camera's center by its rotation vector and translation."""
    columns = []
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = _STEP
        columns.append((_center(pose + step) - _center(pose - step)) / (2 * _STEP))
    return np.stack(columns, 1)


def _center(pose: np.ndarray) -> np.ndarray:
    import cv2

    center: np.ndarray = -cv2.Rodrigues(pose[:3])[0].T @ pose[3:]
    return center
