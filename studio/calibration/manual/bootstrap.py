"""Initial camera poses from a few tie points, for bundle adjustment."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.camera_files.colmap_model import camera_model
from v3studio.studio.cameras import Camera

LEAST_SHARED = 6  # common points needed to estimate the relative pose of two cameras
LEAST_KNOWN = 4  # points with known positions needed to estimate a camera's pose
_PAIRS = 12
_WORST = 0.02  # maximum reprojection error of an initial pose, as a fraction of the longer image side


@dataclass
class Observations:
    """The marks of all tie points: (P, 3) measured positions and, by camera, (P, 2) pixels; NaN for none."""

    points: list[str]
    world: np.ndarray
    pixels: dict[str, np.ndarray]

    def seen(self, camera: str) -> np.ndarray:
        """(P,) bool: points with a mark in the camera."""
        return ~np.isnan(self.pixels[camera][:, 0])

    @property
    def measured(self) -> np.ndarray:
        """(P,) bool: points with a measured position."""
        return ~np.isnan(self.world[:, 0])


@dataclass
class TieRig:
    """Registered cameras, and the positions (P, 3) of all points, NaN if not triangulated; with the marks."""

    cameras: dict[str, Camera]
    points3d: np.ndarray
    observations: Observations

    @property
    def triangulated(self) -> np.ndarray:
        """(P,) bool: points with a position."""
        return ~np.isnan(self.points3d[:, 0])

    def errors(self) -> dict[str, np.ndarray]:
        """Camera name to (P,) reprojection errors in pixels: NaN without a mark, infinite behind the camera."""
        worst = {}
        for name, camera in self.cameras.items():
            pixels, depth = camera.project(np.nan_to_num(self.points3d))
            error = np.linalg.norm(pixels - self.observations.pixels[name], axis=1)
            error[depth <= 0] = np.inf
            error[~(self.observations.seen(name) & self.triangulated)] = np.nan
            worst[name] = error
        return worst


def initial_rigs(intrinsics: Mapping[str, Camera], observations: Observations, seed: int) -> Iterator[TieRig]:
    """Initial rigs to try, the most promising first.

    The first one is based on measured points, if a camera sees four of them. The others are based on the pairs of
    cameras with the most common points, in the coordinates of the first camera.
    """
    measured = observations.measured
    if any((observations.seen(name) & measured).sum() >= LEAST_KNOWN for name in intrinsics):
        yield _grown(intrinsics, TieRig({}, observations.world.copy(), observations), seed)
    shared = {
        pair: np.flatnonzero(observations.seen(pair[0]) & observations.seen(pair[1]))
        for pair in combinations(intrinsics, 2)
    }
    pairs = sorted((pair for pair in shared if len(shared[pair]) >= LEAST_SHARED), key=lambda p: -len(shared[p]))
    for first, second in pairs[:_PAIRS]:
        relative = _relative(intrinsics[first], intrinsics[second], observations, shared[first, second], seed)
        if relative is not None:
            cameras = {
                first: replace(intrinsics[first], world_to_camera=np.eye(4)),
                second: replace(intrinsics[second], world_to_camera=relative),
            }
            yield _grown(intrinsics, TieRig(cameras, np.full_like(observations.world, np.nan), observations), seed)


def _grown(intrinsics: Mapping[str, Camera], rig: TieRig, seed: int) -> TieRig:
    """Register cameras, those with the most points first, and triangulate points until no more can be added."""
    observations = rig.observations
    while True:
        triangulate(rig)
        known = rig.triangulated
        counts = {name: int((observations.seen(name) & known).sum()) for name in intrinsics if name not in rig.cameras}
        has_grown = False
        for name in sorted(counts, key=lambda n: -counts[n]):
            if counts[name] < LEAST_KNOWN:
                break
            index = np.flatnonzero(observations.seen(name) & known)
            pose = _absolute(intrinsics[name], observations.pixels[name][index], rig.points3d[index], seed)
            if pose is not None:
                rig.cameras[name] = replace(intrinsics[name], world_to_camera=pose)
                has_grown = True
                break
        if not has_grown:
            return rig


def triangulate(rig: TieRig) -> None:
    """Triangulate the points that at least two registered cameras see (linear method); changes `rig`."""
    observations = rig.observations
    rays = {name: camera.normalized(observations.pixels[name]) for name, camera in rig.cameras.items()}
    for number in np.flatnonzero(~rig.triangulated):
        rows = []
        for name, camera in rig.cameras.items():
            if observations.seen(name)[number]:
                x, y = rays[name][number]
                pose = camera.world_to_camera[:3]
                rows += [x * pose[2] - pose[0], y * pose[2] - pose[1]]
        if len(rows) >= 4:
            solution = np.linalg.svd(np.array(rows))[2][3]
            if abs(solution[3]) > 1e-9:
                rig.points3d[number] = solution[:3] / solution[3]


def _absolute(camera: Camera, pixels: np.ndarray, points3d: np.ndarray, seed: int) -> np.ndarray | None:
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = _WORST * max(camera.width, camera.height)
    options.ransac.random_seed = seed
    estimate = pycolmap.estimate_and_refine_absolute_pose(pixels, points3d, _sensor(camera), options)
    if estimate is None or estimate["num_inliers"] < LEAST_KNOWN:
        return None
    return np.vstack([estimate["cam_from_world"].matrix(), [0, 0, 0, 1]])


def _relative(
    first: Camera, second: Camera, observations: Observations, shared: np.ndarray, seed: int
) -> np.ndarray | None:
    """(4, 4) transform from the first to the second camera, with a baseline of 1; None if not found."""
    options = pycolmap.TwoViewGeometryOptions()
    options.min_num_inliers = LEAST_SHARED - 1
    options.compute_relative_pose = True
    options.detect_watermark = False
    options.ransac.max_error = _WORST / 4 * max(first.width, first.height)
    options.ransac.random_seed = seed
    points = [observations.pixels[camera.name][shared] for camera in (first, second)]
    matches = np.repeat(np.arange(len(shared), dtype=np.uint32)[:, None], 2, axis=1)
    geometry = pycolmap.estimate_calibrated_two_view_geometry(
        _sensor(first), points[0], _sensor(second), points[1], matches, options
    )
    pose = geometry.cam2_from_cam1
    if pose is None or not np.linalg.norm(pose.translation) > 1e-6:
        return None
    return np.vstack([pose.matrix(), [0, 0, 0, 1]])


def _sensor(camera: Camera) -> Any:
    model, parameters = camera_model(camera)
    return pycolmap.Camera(model=model, width=camera.width, height=camera.height, params=parameters)
