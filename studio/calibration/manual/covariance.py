"""Uncertainty of the camera positions, and degenerate configurations of tie points."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from v3studio.studio.calibration.alignment import align_points
from v3studio.studio.calibration.manual.bootstrap import TieRig
from v3studio.studio.calibration.manual.bundle_adjustment import WORLD, Problem
from v3studio.studio.errors import StudioError

_FREE = 7
_WEAKEST = 1e-12


def check_plausible(rig: TieRig) -> None:
    """Check that the result of the bundle adjustment is not degenerate."""
    observations = rig.observations
    errors = np.concatenate(list(rig.errors().values()))
    behind = float(np.isinf(errors[~np.isnan(errors)]).mean()) > 0.3
    which = observations.measured & rig.triangulated
    smaller = which.sum() > 1 and np.linalg.norm(np.ptp(rig.points3d[which], 0)) < 0.2 * np.linalg.norm(
        np.ptp(observations.world[which], 0)
    )
    if smaller or (behind and which.any()):
        fix = "Check the measured positions; their axes must be right-handed with z up."
        raise StudioError("tie_points.contradiction", "the measured positions contradict the marks", fix=fix)
    if behind:
        problem = "the points would be behind the cameras that fit the marks"
        raise StudioError("tie_points.behind", problem, fix="Check the marks.")


def check_handedness(rig: TieRig) -> None:
    """Check that the measured positions are not a mirror image of what the marks say."""
    which = rig.observations.measured & rig.triangulated
    if which.sum() < 4:
        return
    points3d, world = rig.points3d[which], rig.observations.world[which]
    proper, mirrored = (_misfit(points3d, world * signs) for signs in ([1, 1, 1], [1, 1, -1]))
    if proper > 3 * WORLD and mirrored < proper / 4:
        problem = "the measured positions are a mirror image of what the marks say"
        fix = "Check the measured positions; their axes must be right-handed with z up."
        raise StudioError("tie_points.contradiction", problem, value=round(proper, 3), fix=fix)


def _misfit(points3d: np.ndarray, world: np.ndarray) -> float:
    """Root mean square distance after the best similarity transform."""
    off = align_points(points3d, world).points(points3d) - world
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def uncertainty(rig: TieRig, groups: Sequence[Sequence[str]], *, radial: bool) -> dict[str, float]:
    """1-sigma uncertainty of each camera's center, as a fraction of the mean distance between cameras and points.

    Computed from the Jacobian at the solution. The uncertainty is relative to the other cameras: the position,
    orientation and scale of the world as a whole are excluded.
    """
    problem = Problem(rig, groups, radial)
    unmeasured = replace(rig.observations, world=np.full_like(rig.observations.world, np.nan))
    marks = Problem(replace(rig, observations=unmeasured), groups, radial)
    parameters = problem.start()
    points3d = rig.points3d[problem.triangulated]
    size = float(np.mean([np.linalg.norm(points3d - c.center, axis=1).mean() for c in rig.cameras.values()]))
    units = np.ones(len(parameters))
    for number in range(len(problem.names)):
        units[6 * number + 3 : 6 * number + 6] = size
    units[problem.first_point :] = size
    of_marks, of_all = (each.jacobian(parameters) * units for each in (marks, problem))
    # the seven gauge freedoms of the marks: position, orientation and scale of the world
    nothing = np.linalg.eigh(of_marks.T @ of_marks)[1][:, :_FREE]
    strengths, directions = np.linalg.eigh(of_all.T @ of_all + nothing @ nothing.T)
    roots = directions / np.sqrt(np.maximum(strengths, _WEAKEST))
    roots = roots - nothing @ (nothing.T @ roots)
    residuals = marks.residuals(parameters)
    beyond = len(residuals) - len(parameters) + _FREE
    noise = max(1.0, float(np.sqrt((residuals**2).sum() / beyond))) if beyond > 0 else 1.0
    deviations = {}
    for number, name in enumerate(problem.names):
        own = slice(6 * number, 6 * number + 6)
        slopes = _center_slopes(parameters[own]) * units[own]
        deviations[name] = noise * float(np.linalg.norm(slopes @ roots[own])) / size
    return deviations


def _center_slopes(pose: np.ndarray) -> np.ndarray:
    """(3, 6) derivatives of a camera center with respect to rotation vector and translation."""
    turn, slopes = cv2.Rodrigues(pose[:3])
    return np.column_stack([-(slopes.reshape(3, 3, 3).transpose(0, 2, 1) @ pose[3:]).T, -turn.T])
