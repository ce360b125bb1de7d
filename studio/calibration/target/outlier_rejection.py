"""Adjusting a rig before a board while leaving out what cannot be true."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studio.calibration.target.bundle_adjustment import TargetRig, refine
from studio.calibration.target.intrinsics import reprojection, target_pose
from studio.calibration.target.pattern import CalibrationTarget, TargetObservation
from studio.cameras import Camera
from studio.errors import StudioError


def settle(
    state: TargetRig,
    board: CalibrationTarget,
    model: str,
    outlier: float,
    *,
    known: Mapping[str, Camera],
    principal_point: bool,
    threads: int,
) -> tuple[TargetRig, int]:
    """Adjust, leave out what lies far off, adjust again; how many corners went.

    A camera that is not quite at the same instant as the others shows a moving board beside its place: whole views
    are then wrong although every one of them is sharp. So the limit for a view is set by how well the views fit a
    board of their own, not by how well they fit together.
    """
    poses = {key: target_pose(state.cameras[key[1]], board, view) for key, view in state.views.items()}
    limit = max(0.5, outlier * float(np.median([error for _, error in poses.values()])))
    everything = dict(state.views)
    counts: list[dict[tuple[int, str], int]] = []
    for widening in (3.0, 2.0, 1.0, 1.0, 1.0):
        state = refine(state, board, model, known=known, principal_point=principal_point, threads=threads)
        boards = {
            sync_frame: _consensus(sync_frame, state, board, everything, poses, limit)
            for sync_frame in _sync_frames(everything)
        }
        kept = _fitting(TargetRig(state.cameras, boards, everything), board, widening * limit)
        if {name for _, name in kept} != set(state.cameras):
            lost = sorted(set(state.cameras) - {name for _, name in kept})
            raise StudioError(
                f"Camera '{lost[0]}': what it sees of the board fits no common place; check that the footage is "
                "synchronized and the board's description is right."
            )
        state = TargetRig(state.cameras, {sync_frame: boards[sync_frame] for sync_frame in _sync_frames(kept)}, kept)
        counts.append({key: len(view.ids) for key, view in kept.items()})
        if widening == 1.0 and len(counts) > 1 and counts[-1] == counts[-2]:
            break
    state = refine(state, board, model, known=known, principal_point=principal_point, threads=threads)
    corners = sum(len(view.ids) for view in everything.values()) - sum(len(view.ids) for view in state.views.values())
    return state, corners


def _sync_frames(views: Mapping[tuple[int, str], TargetObservation]) -> list[int]:
    return sorted({sync_frame for sync_frame, _ in views})


def _consensus(
    sync_frame: int,
    state: TargetRig,
    board: CalibrationTarget,
    views: Mapping[tuple[int, str], TargetObservation],
    poses: Mapping[tuple[int, str], tuple[np.ndarray, float]],
    limit: float,
) -> np.ndarray:
    """The place of a moment's board with which most of its views agree: the present one, or what one camera says."""
    seen = [name for name in state.cameras if (sync_frame, name) in views]
    ways = [np.linalg.inv(state.cameras[name].world_to_camera) @ poses[sync_frame, name][0] for name in seen]
    if sync_frame in state.boards:
        ways.insert(0, state.boards[sync_frame])
    best, found = np.inf, ways[0]
    for way in ways:
        cost = 0.0
        for name in seen:
            view, camera = views[sync_frame, name], state.cameras[name]
            errors = reprojection(camera, camera.world_to_camera @ way, board.corners[view.ids], view.pixels)
            cost += min(float(np.median(errors)), 4 * limit)
        if cost < best:
            best, found = cost, way
    return found


def _fitting(state: TargetRig, board: CalibrationTarget, limit: float) -> dict[tuple[int, str], TargetObservation]:
    """The views, and of these the corners, that lie within the limit; of each camera the best 40 % in any case."""
    errors = state.errors(board)
    middles = {key: float(np.median(error)) for key, error in errors.items()}
    allowed = {}
    for name in state.cameras:
        own = [middle for (_, camera), middle in middles.items() if camera == name]
        allowed[name] = max(limit, float(np.quantile(own, 0.4))) if own else limit
    kept = {}
    for key, view in state.views.items():
        if middles[key] > allowed[key[1]]:
            continue
        slim = view.keep(errors[key] <= 2 * allowed[key[1]])
        if len(slim.ids) >= 4 and not slim.on_one_line(board):
            kept[key] = slim
    return kept
