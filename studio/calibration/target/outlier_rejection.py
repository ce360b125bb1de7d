"""Adjusting a rig before a board while leaving out what cannot be true."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from studio.calibration.target.bundle_adjustment import BoardRig, refine
from studio.calibration.target.intrinsics import board_pose, reprojection
from studio.calibration.target.pattern import Board, View
from studio.cameras import Camera
from studio.errors import StudioError


def settle(
    state: BoardRig,
    board: Board,
    model: str,
    outlier: float,
    *,
    known: Mapping[str, Camera],
    principal_point: bool,
    threads: int,
) -> tuple[BoardRig, int]:
    """Adjust, leave out what lies far off, adjust again; how many corners went.

    A camera that is not quite at the same instant as the others shows a moving board beside its place: whole views
    are then wrong although every one of them is sharp. So the limit for a view is set by how well the views fit a
    board of their own, not by how well they fit together.
    """
    poses = {key: board_pose(state.cameras[key[1]], board, view) for key, view in state.views.items()}
    limit = max(0.5, outlier * float(np.median([error for _, error in poses.values()])))
    everything = dict(state.views)
    counts: list[dict[tuple[int, str], int]] = []
    for widening in (3.0, 2.0, 1.0, 1.0, 1.0):
        state = refine(state, board, model, known=known, principal_point=principal_point, threads=threads)
        boards = {moment: _consensus(moment, state, board, everything, poses, limit) for moment in _moments(everything)}
        kept = _fitting(BoardRig(state.cameras, boards, everything), board, widening * limit)
        if {name for _, name in kept} != set(state.cameras):
            lost = sorted(set(state.cameras) - {name for _, name in kept})
            raise StudioError(
                f"Camera '{lost[0]}': what it sees of the board fits no common place; check that the footage is "
                "synchronized and the board's description is right."
            )
        state = BoardRig(state.cameras, {moment: boards[moment] for moment in _moments(kept)}, kept)
        counts.append({key: len(view.ids) for key, view in kept.items()})
        if widening == 1.0 and len(counts) > 1 and counts[-1] == counts[-2]:
            break
    state = refine(state, board, model, known=known, principal_point=principal_point, threads=threads)
    corners = sum(len(view.ids) for view in everything.values()) - sum(len(view.ids) for view in state.views.values())
    return state, corners


def _moments(views: Mapping[tuple[int, str], View]) -> list[int]:
    return sorted({moment for moment, _ in views})


def _consensus(
    moment: int,
    state: BoardRig,
    board: Board,
    views: Mapping[tuple[int, str], View],
    poses: Mapping[tuple[int, str], tuple[np.ndarray, float]],
    limit: float,
) -> np.ndarray:
    """The place of a moment's board with which most of its views agree: the present one, or what one camera says."""
    seen = [name for name in state.cameras if (moment, name) in views]
    ways = [np.linalg.inv(state.cameras[name].world_to_camera) @ poses[moment, name][0] for name in seen]
    if moment in state.boards:
        ways.insert(0, state.boards[moment])
    best, found = np.inf, ways[0]
    for way in ways:
        cost = 0.0
        for name in seen:
            view, camera = views[moment, name], state.cameras[name]
            errors = reprojection(camera, camera.world_to_camera @ way, board.corners[view.ids], view.pixels)
            cost += min(float(np.median(errors)), 4 * limit)
        if cost < best:
            best, found = cost, way
    return found


def _fitting(state: BoardRig, board: Board, limit: float) -> dict[tuple[int, str], View]:
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
