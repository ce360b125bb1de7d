"""Where cameras stand, from few points marked by hand: a start for the adjustment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from studio.camera_files.colmap_model import lens_model
from studio.cameras import Camera

LEAST_SHARED = 6
"""Points that two cameras must share so that one is placed to the other."""
LEAST_PLACED = 4
"""Points of known places that a camera must see so that it finds its own."""
_PAIRS = 12
_WORST = 0.02
"""Of the image's longer side: what the first rough places may be off by."""


@dataclass
class Observations:
    """What cameras see of the points.

    Attributes:
        points: names.
        world: (P, 3) measured places, NaN where there is none.
        pixels: camera name to (P, 2), NaN where it does not see the point.
    """

    points: list[str]
    world: np.ndarray
    pixels: dict[str, np.ndarray]

    def seen(self, camera: str) -> np.ndarray:
        """(P,) bool."""
        return ~np.isnan(self.pixels[camera][:, 0])

    @property
    def measured(self) -> np.ndarray:
        """(P,) bool: points whose place in the world is known."""
        return ~np.isnan(self.world[:, 0])


@dataclass
class TieRig:
    """Cameras with a pose, and the points' places (P, 3), NaN where none was found."""

    cameras: dict[str, Camera]
    places: np.ndarray

    @property
    def placed(self) -> np.ndarray:
        """(P,) bool: points whose place was found."""
        return ~np.isnan(self.places[:, 0])

    def errors(self, observations: Observations) -> dict[str, np.ndarray]:
        """Camera name to (P,) reprojection errors in pixels; NaN where not seen, infinite behind the camera."""
        found = {}
        for name, camera in self.cameras.items():
            pixels, depth = camera.project(np.nan_to_num(self.places))
            error = np.linalg.norm(pixels - observations.pixels[name], axis=1)
            error[depth <= 0] = np.inf
            error[~(observations.seen(name) & self.placed)] = np.nan
            found[name] = error
        return found


def starts(lenses: Mapping[str, Camera], observations: Observations, seed: int) -> Iterator[TieRig]:
    """Ways in which the cameras could stand, likely ones first.

    From points with measured places where a camera sees four of them; then from the pairs of cameras that share most
    points, in the first one's coordinates.
    """
    measured = observations.measured
    if any((observations.seen(name) & measured).sum() >= LEAST_PLACED for name in lenses):
        yield _grown(lenses, observations, TieRig({}, observations.world.copy()), seed)
    shared = {
        pair: np.flatnonzero(observations.seen(pair[0]) & observations.seen(pair[1]))
        for pair in combinations(lenses, 2)
    }
    pairs = sorted((pair for pair in shared if len(shared[pair]) >= LEAST_SHARED), key=lambda p: -len(shared[p]))
    for first, second in pairs[:_PAIRS]:
        relative = _relative(lenses[first], lenses[second], observations, shared[first, second], seed)
        if relative is not None:
            cameras = {
                first: replace(lenses[first], world_to_camera=np.eye(4)),
                second: replace(lenses[second], world_to_camera=relative),
            }
            begun = TieRig(cameras, np.full_like(observations.world, np.nan))
            yield _grown(lenses, observations, begun, seed)


def _grown(lenses: Mapping[str, Camera], observations: Observations, rig: TieRig, seed: int) -> TieRig:
    """With all cameras and points that follow from those that stand, the surest first."""
    while True:
        triangulate(observations, rig)
        placed = rig.placed
        counts = {name: int((observations.seen(name) & placed).sum()) for name in lenses if name not in rig.cameras}
        found = False
        for name in sorted(counts, key=lambda n: -counts[n]):
            if counts[name] < LEAST_PLACED:
                break
            index = np.flatnonzero(observations.seen(name) & placed)
            pose = _absolute(lenses[name], observations.pixels[name][index], rig.places[index], seed)
            if pose is not None:
                rig.cameras[name] = replace(lenses[name], world_to_camera=pose)
                found = True
                break
        if not found:
            return rig


def triangulate(observations: Observations, rig: TieRig) -> None:
    """Places of points that two standing cameras see, by the linear method; in place."""
    rays = {name: pixel_rays(camera, observations.pixels[name]) for name, camera in rig.cameras.items()}
    for number in np.flatnonzero(~rig.placed):
        rows = []
        for name, camera in rig.cameras.items():
            if observations.seen(name)[number]:
                x, y = rays[name][number]
                pose = camera.world_to_camera[:3]
                rows += [x * pose[2] - pose[0], y * pose[2] - pose[1]]
        if len(rows) >= 4:
            solution = np.linalg.svd(np.array(rows))[2][3]
            if abs(solution[3]) > 1e-9:
                rig.places[number] = solution[:3] / solution[3]


def pixel_rays(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """(P, 2) undistorted, at depth 1; NaN stays."""
    import cv2

    known = ~np.isnan(pixels[:, 0])
    rays = np.full_like(pixels, np.nan)
    if known.any():
        distortion = camera.distortion if camera.distortion.size else None
        rays[known] = cv2.undistortPoints(pixels[known][:, None], camera.K, distortion).reshape(-1, 2)
    return rays


def _absolute(camera: Camera, pixels: np.ndarray, places: np.ndarray, seed: int) -> np.ndarray | None:
    import pycolmap

    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = _WORST * max(camera.width, camera.height)
    options.ransac.random_seed = seed
    found = pycolmap.estimate_and_refine_absolute_pose(pixels, places, _sensor(camera), options)
    if found is None or found["num_inliers"] < LEAST_PLACED:
        return None
    return np.vstack([found["cam_from_world"].matrix(), [0, 0, 0, 1]])


def _relative(
    first: Camera, second: Camera, observations: Observations, shared: np.ndarray, seed: int
) -> np.ndarray | None:
    """(4, 4) from the first camera to the second, at a distance of 1."""
    import pycolmap

    options = pycolmap.TwoViewGeometryOptions()
    options.min_num_inliers = LEAST_SHARED - 1
    options.compute_relative_pose = True
    options.detect_watermark = False
    options.ransac.max_error = _WORST / 4 * max(first.width, first.height)
    options.ransac.random_seed = seed
    points = [observations.pixels[camera.name][shared] for camera in (first, second)]
    matches = np.repeat(np.arange(len(shared), dtype=np.uint32)[:, None], 2, axis=1)
    found = pycolmap.estimate_calibrated_two_view_geometry(
        _sensor(first), points[0], _sensor(second), points[1], matches, options
    )
    pose = found.cam2_from_cam1
    if pose is None or not np.linalg.norm(pose.translation) > 1e-6:
        return None
    return np.vstack([pose.matrix(), [0, 0, 0, 1]])


def _sensor(camera: Camera) -> Any:
    import pycolmap

    model, parameters = lens_model(camera)
    return pycolmap.Camera(model=model, width=camera.width, height=camera.height, params=parameters)
