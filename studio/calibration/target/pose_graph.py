"""Initial camera poses from sync frames in which two cameras see the target."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from v3studio.studio.calibration.target.bundle_adjustment import TargetRig, best_pose
from v3studio.studio.calibration.target.intrinsics import target_pose
from v3studio.studio.calibration.target.pattern import TargetObservation
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError

_WORST = 5.0  # observations with a larger RMS error at their own best target pose are ignored; in pixels
_MOST = 50.0  # pixels that the median error of an observation counts at most when poses are compared


def chain_poses(intrinsics: Mapping[str, Camera], views: Mapping[tuple[int, str], TargetObservation]) -> TargetRig:
    """Chain relative camera poses along the pairs with the most common sync frames (maximum spanning tree).

    Takes cameras' intrinsics by name and observations by (sync frame, camera). The result has cameras in the
    coordinates of the first one, and target poses of all sync frames with a usable observation.
    """
    poses: dict[tuple[int, str], np.ndarray] = {}
    for key, view in views.items():
        pose, error = target_pose(intrinsics[key[1]], view)
        if error < _WORST:
            poses[key] = pose
    kept = {key: views[key] for key in poses}
    if not kept:
        name = next(iter(intrinsics))
        count = sum(camera == name for _, camera in views)
        problem = f"camera '{name}': no intrinsics fit its {count} images of the target"
        fix = "Check that calibrate.board describes the target, and film it again."
        raise StudioError("target.no_fit", problem, value=count, fix=fix, camera=name, setting="calibrate.board")
    seen = {name: {sync_frame for sync_frame, camera in poses if camera == name} for name in intrinsics}
    links = {pair: sorted(both) for pair in combinations(seen, 2) if (both := seen[pair[0]] & seen[pair[1]])}
    registered = {next(iter(intrinsics)): np.eye(4)}
    while True:
        # the strongest link from a registered camera to one that has not been placed
        ways = [(len(shared), pair) for pair, shared in links.items() if len(registered.keys() & set(pair)) == 1]
        if not ways:
            break
        _, pair = max(ways)
        known, new = pair if pair[0] in registered else pair[::-1]
        relative = _relative(intrinsics[new], known, kept, poses, links[pair])
        registered[new] = relative @ registered[known]
    lost = [name for name in intrinsics if name not in registered]
    if lost:
        problem = (
            f"there is no sync frame in which both {' or '.join(lost)} and {' or '.join(registered)} see the target"
        )
        fix = "Film the target where cameras of both groups see it."
        raise StudioError("target.not_connected", problem, value=lost, fix=fix, camera=lost[0], cameras=lost)
    cameras = {name: replace(intrinsics[name], world_to_camera=registered[name]) for name in intrinsics}
    state = TargetRig(cameras, {}, kept)
    frames = sorted({sync_frame for sync_frame, _ in kept})
    return replace(state, target_poses={at: state.consensus(at, poses, _MOST) for at in frames})


def _relative(
    camera: Camera,
    other: str,
    views: Mapping[tuple[int, str], TargetObservation],
    poses: Mapping[tuple[int, str], np.ndarray],
    shared: list[int],
) -> np.ndarray:
    """(4, 4) from another camera to this one: the candidate, one per sync frame, that fits all sync frames best."""
    trial = shared if len(shared) <= 24 else [shared[i] for i in np.linspace(0, len(shared) - 1, 24).astype(int)]
    candidates = [poses[at, camera.name] @ np.linalg.inv(poses[at, other]) for at in trial]
    return best_pose(
        candidates, lambda pose: (views[at, camera.name].errors(camera, pose @ poses[at, other]) for at in trial), _MOST
    )
