"""Initial camera poses from sync frames in which two cameras see the target."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from studio.calibration.target.bundle_adjustment import TargetRig
from studio.calibration.target.intrinsics import reprojection, target_pose
from studio.calibration.target.pattern import CalibrationTarget, TargetObservation
from studio.cameras import Camera
from studio.errors import StudioError

_WORST = 5.0  # observations with a larger RMS error at their own best target pose are ignored; in pixels


def chain_poses(
    intrinsics: Mapping[str, Camera], target: CalibrationTarget, views: Mapping[tuple[int, str], TargetObservation]
) -> TargetRig:
    """Chain relative camera poses along the pairs with the most common sync frames (maximum spanning tree).

    Takes cameras' intrinsics by name and observations by (sync frame, camera). The result has cameras in the
    coordinates of the first one, and target poses of all sync frames with a usable observation.
    """
    poses: dict[tuple[int, str], np.ndarray] = {}
    for key, view in views.items():
        pose, error = target_pose(intrinsics[key[1]], target, view)
        if error < _WORST:
            poses[key] = pose
    kept = {key: views[key] for key in poses}
    sync_frames: dict[str, set[int]] = {name: set() for name in intrinsics}
    for sync_frame, name in poses:
        sync_frames[name].add(sync_frame)
    links = {}
    for first, second in combinations(intrinsics, 2):
        shared = sorted(sync_frames[first] & sync_frames[second])
        if shared:
            links[first, second] = shared
    registered = {next(iter(intrinsics)): np.eye(4)}
    while True:
        # the strongest link from a registered camera to one that has not been placed
        ways = [(len(shared), pair) for pair, shared in links.items() if len(registered.keys() & set(pair)) == 1]
        if not ways:
            break
        _, pair = max(ways)
        known, new = pair if pair[0] in registered else pair[::-1]
        relative = _relative(intrinsics, target, kept, poses, known, new, links[pair])
        registered[new] = relative @ registered[known]
    lost = [name for name in intrinsics if name not in registered]
    if lost:
        problem = (
            f"there is no sync frame in which both {' or '.join(lost)} and {' or '.join(registered)} see the target"
        )
        fix = "Film the target where cameras of both groups see it."
        raise StudioError("target.not_connected", problem, value=lost, fix=fix, camera=lost[0], cameras=lost)
    cameras = {name: replace(intrinsics[name], world_to_camera=registered[name]) for name in intrinsics}
    target_poses = {}
    for sync_frame in sorted({sync_frame for sync_frame, _ in kept}):
        seen = [name for name in intrinsics if (sync_frame, name) in kept]
        candidates = [np.linalg.inv(registered[name]) @ poses[sync_frame, name] for name in seen]
        costs = []
        for candidate in candidates:
            errors = (
                reprojection(intrinsics[name], registered[name] @ candidate, *_seen(target, kept[sync_frame, name]))
                for name in seen
            )
            costs.append(sum(min(50.0, float(np.median(error))) for error in errors))
        target_poses[sync_frame] = candidates[int(np.argmin(costs))]
    return TargetRig(cameras, target_poses, kept)


def _seen(target: CalibrationTarget, view: TargetObservation) -> tuple[np.ndarray, np.ndarray]:
    return target.corners[view.ids], view.pixels


def _relative(
    intrinsics: Mapping[str, Camera],
    target: CalibrationTarget,
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
                            intrinsics[second], candidate @ poses[other, first], *_seen(target, views[other, second])
                        )
                    )
                ),
            )
            for other in trial
        )
        if cost < best:
            best, found = cost, candidate
    return found
