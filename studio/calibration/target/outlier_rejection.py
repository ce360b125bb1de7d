"""Bundle adjustment with rejection of inconsistent observations."""

from collections.abc import Mapping

import numpy as np

from v3studio.studio.calibration.target.bundle_adjustment import TargetRig, refine
from v3studio.studio.calibration.target.intrinsics import target_pose
from v3studio.studio.calibration.target.pattern import TargetObservation
from v3studio.studio.errors import StudioError

_OUTLIER = 4.0
"""Outlier threshold as a multiple of the median error of the views, each at its own best target pose. Larger errors
mean that the target moved and the cameras are not exactly synchronized."""


def refine_without_outliers(state: TargetRig, model: str | None, *, principal_point: bool, threads: int) -> TargetRig:
    """Alternate bundle adjustment and outlier rejection.

    A camera that is not exactly synchronized sees a moving target at a different position, so its whole observation is
    wrong even if it is sharp. The threshold is therefore derived from the error of each observation at its own best
    target pose, not at the common pose: `_OUTLIER` times the median of these errors, at least 0.5 pixels.
    """
    alone = {key: target_pose(state.cameras[key[1]], view) for key, view in state.views.items()}
    poses = {key: pose for key, (pose, _) in alone.items()}
    limit = max(0.5, _OUTLIER * float(np.median([error for _, error in alone.values()])))
    everything = dict(state.views)
    counts: list[dict[tuple[int, str], int]] = []
    for widening in (3.0, 2.0, 1.0, 1.0, 1.0):
        state = refine(state, model, principal_point=principal_point, threads=threads)
        before = TargetRig(state.cameras, state.target_poses, everything)
        target_poses = {at: before.consensus(at, poses, 4 * limit) for at in _sync_frames(everything)}
        kept = _fitting(TargetRig(state.cameras, target_poses, everything), widening * limit)
        if {name for _, name in kept} != set(state.cameras):
            lost = sorted(set(state.cameras) - {name for _, name in kept})
            problem = f"camera '{lost[0]}': its observations of the target are not consistent with the other cameras"
            fix = "Check that the footage is synchronized and calibrate.board describes the target."
            raise StudioError(
                "target.inconsistent", problem, value=lost, fix=fix, camera=lost[0], setting="calibrate.board"
            )
        state = TargetRig(state.cameras, {at: target_poses[at] for at in _sync_frames(kept)}, kept)
        counts.append({key: len(view.ids) for key, view in kept.items()})
        if widening == 1.0 and len(counts) > 1 and counts[-1] == counts[-2]:
            break
    return refine(state, model, principal_point=principal_point, threads=threads)


def _sync_frames(views: Mapping[tuple[int, str], TargetObservation]) -> list[int]:
    return sorted({sync_frame for sync_frame, _ in views})


def _fitting(state: TargetRig, limit: float) -> dict[tuple[int, str], TargetObservation]:
    """The observations and corners within the limit; at least the best 40% of each camera's observations."""
    errors = state.errors()
    middles = {key: float(np.median(error)) for key, error in errors.items()}
    allowed = {}
    for name in state.cameras:
        own = [middle for (_, camera), middle in middles.items() if camera == name]
        allowed[name] = max(limit, float(np.quantile(own, 0.4))) if own else limit
    kept = {}
    for key, view in state.views.items():
        if middles[key] > allowed[key[1]]:
            continue
        good = errors[key] <= 2 * allowed[key[1]]
        if good.sum() >= 4 and not view.target.on_one_line(view.ids[good]):
            kept[key] = TargetObservation(view.target, view.ids[good], view.pixels[good])
    return kept
