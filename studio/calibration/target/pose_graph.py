"""From boards that pairs of cameras see at one moment to where all cameras stand: the start of the adjustment."""

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
"""Pixels: a view whose own best pose fits worse than this is left out."""


def chain(
    lenses: Mapping[str, Camera], board: CalibrationTarget, views: Mapping[tuple[int, str], TargetObservation]
) -> TargetRig:
    """Place the cameras by the moments that pairs share, along the pairs that share most.

    Args:
        lenses: name to camera with its lens; poses are not used.
        board: what they see.
        views: (moment, camera) to what is seen.

    Returns:
        cameras in the first one's coordinates, and the boards of all moments with a usable view.

    Raises:
        StudioError: cameras that no chain of shared moments reaches, named.
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
    places = {next(iter(lenses)): np.eye(4)}
    while True:
        # the strongest link from what stands to what does not
        ways = [(len(shared), pair) for pair, shared in links.items() if (pair[0] in places) != (pair[1] in places)]
        if not ways:
            break
        _, pair = max(ways)
        known, new = pair if pair[0] in places else pair[::-1]
        relative = _relative(lenses, board, kept, poses, known, new, links[pair])
        places[new] = relative @ places[known]
    lost = [name for name in lenses if name not in places]
    if lost:
        raise StudioError(
            f"Camera '{lost[0]}'"
            + (f" and {len(lost) - 1} more ({', '.join(lost[1:])})" if len(lost) > 1 else "")
            + f" never see the board at a moment when {', '.join(places)} see it; film the board where both see it."
        )
    cameras = {name: replace(lenses[name], world_to_camera=places[name]) for name in lenses}
    boards = {}
    for sync_frame in sorted({sync_frame for sync_frame, _ in kept}):
        seen = [name for name in lenses if (sync_frame, name) in kept]
        candidates = [np.linalg.inv(places[name]) @ poses[sync_frame, name] for name in seen]
        costs = [
            sum(
                min(50.0, float(np.median(reprojection(lenses[n], places[n] @ c, *_seen(board, kept[sync_frame, n])))))
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
    """(4, 4) from the first camera to the second: of what each moment says, the one that fits all moments best."""
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
