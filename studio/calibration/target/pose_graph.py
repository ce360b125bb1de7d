"""Initial camera poses from sync frames in which two cameras see the target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from studio.calibration.target.bundle_adjustment import TargetRig
from studio.calibration.target.intrinsics import reprojection, target_pose
from studio.calibration.target.pattern import CalibrationTarget, TargetObservation
from studio.cameras import Camera
from studio.errors import StudioError

_WORST = 5.0
"""Observations with a larger RMS error at their own best target pose are ignored; in pixels."""


def chain_poses(
    lenses: Mapping[str, Camera], board: CalibrationTarget, views: Mapping[tuple[int, str], TargetObservation]
) -> TargetRig:
    """Chain relative camera poses along the pairs with the most common sync frames (maximum spanning tree).

    Args:
        lenses: name to camera with intrinsics; poses are not used.
        board: the target.
        views: (sync frame, camera) to observation.

    Returns:
        cameras in the coordinates of the first one, and target poses of all sync frames with a usable observation.

    Raises:
        StudioError: a camera is not connected to the others (target.not_connected, with `cameras`).
    """
    poses: dict[tuple[int, str], np.ndarray] = {}
    for key, view in views.items():
        pose, error = target_pose(lenses[key[1]], board, view)
        if error < _WORST:
            poses[key] = pose
    kept = {key: views[key] for key in poses}
    sync_frames: dict[str, set[int]] = {name: set() for name in lenses}
    for sync_frame, name in poses:
        sync_frames[name].add(sync_frame)
    links = {}
    for first, second in combinations(lenses, 2):
        shared = sorted(sync_frames[first] & sync_frames[second])
        if shared:
            links[first, second] = shared
    placed = {next(iter(lenses)): np.eye(4)}
    while True:
        # the strongest link from a placed camera to one that has not been placed
        ways = [(len(shared), pair) for pair, shared in links.items() if (pair[0] in placed) != (pair[1] in placed)]
        if not ways:
            break
        _, pair = max(ways)
        known, new = pair if pair[0] in placed else pair[::-1]
        relative = _relative(lenses, board, kept, poses, known, new, links[pair])
        placed[new] = relative @ placed[known]
    lost = [name for name in lenses if name not in placed]
    if lost:
        raise StudioError(
            "target.not_connected",
            f"there is no sync frame in which both {' or '.join(lost)} and {' or '.join(placed)} see the target",
            value=lost,
            fix="Film the target where cameras of both groups see it.",
            camera=lost[0],
            cameras=lost,
        )
    cameras = {name: replace(lenses[name], world_to_camera=placed[name]) for name in lenses}
    boards = {}
    for sync_frame in sorted({sync_frame for sync_frame, _ in kept}):
        seen = [name for name in lenses if (sync_frame, name) in kept]
        candidates = [np.linalg.inv(placed[name]) @ poses[sync_frame, name] for name in seen]
        costs = [
            sum(
                min(50.0, float(np.median(reprojection(lenses[n], placed[n] @ c, *_seen(board, kept[sync_frame, n])))))
                for n in seen
            )
            for c in candidates
        ]
        boards[sync_frame] = candidates[int(np.argmin(costs))]
    return TargetRig(cameras, boards, kept)


def _seen(board: CalibrationTarget, view: TargetObservation) -> tuple[np.ndarray, np.ndarray]:
    return board.corners[view.ids], view.pixels


def _relative(
    lenses: Mapping[str, Camera],
    board: CalibrationTarget,
    views: Mapping[tuple[int, str], TargetObservation],
    poses: Mapping[tuple[int, str], np.ndarray],
    first: str,
    second: str,
    shared: list[int],
) -> np.ndarray:
    """(4, 4) first to second camera: the candidate, one per sync frame, that fits all sync frames best."""
    trial = shared if len(shared) <= 24 else [shared[i] for i in np.linspace(0, len(shared) - 1, 24).astype(int)]
    best, found = np.inf, np.eye(4)
    for sync_frame in trial:
        candidate = poses[sync_frame, second] @ np.linalg.inv(poses[sync_frame, first])
        cost = sum(
            min(
                50.0,
                float(
                    np.median(
                        reprojection(
                            lenses[second], candidate @ poses[other, first], *_seen(board, views[other, second])
                        )
                    )
                ),
            )
            for other in trial
        )
        if cost < best:
            best, found = cost, candidate
    return found
