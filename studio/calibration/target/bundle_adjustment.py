"""Bundle adjustment of a rig that observes a calibration target, with COLMAP.

To COLMAP, the target is the static world, and the cameras are one rig that moves around it, with one COLMAP frame per
sync frame. The corners are constant points, so the result is metric and free of drift.
"""

import logging
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.settings import USUAL_MODEL
from v3studio.studio.calibration.target.pattern import TargetObservation
from v3studio.studio.camera_files.colmap_model import intrinsics, model_parameters
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.process import logged

_LOG = logging.getLogger(__name__)


@dataclass
class TargetRig:
    """Cameras by name (`world_to_camera` maps from rig coordinates), (4, 4) target poses, target to rig, by sync frame,
    and observations by (sync frame, camera)."""

    cameras: dict[str, Camera]
    target_poses: dict[int, np.ndarray]
    views: dict[tuple[int, str], TargetObservation]

    def errors(self) -> dict[tuple[int, str], np.ndarray]:
        """Reprojection errors (M,) in pixels of each observation."""
        poses = {name: camera.world_to_camera for name, camera in self.cameras.items()}
        return {
            (at, name): view.errors(self.cameras[name], poses[name] @ self.target_poses[at])
            for (at, name), view in self.views.items()
        }

    def consensus(self, sync_frame: int, poses: Mapping[tuple[int, str], np.ndarray], most: float) -> np.ndarray:
        """The target pose of a sync frame that fits most observations: the current pose, or the one that a single
        camera sees. `poses`: (4, 4) target to camera, of each observation alone; `most`: see `best_pose`."""
        seen = [camera for camera in self.cameras.values() if (sync_frame, camera.name) in self.views]
        ways = [np.linalg.inv(camera.world_to_camera) @ poses[sync_frame, camera.name] for camera in seen]
        if sync_frame in self.target_poses:
            ways.insert(0, self.target_poses[sync_frame])
        views = {camera.name: self.views[sync_frame, camera.name] for camera in seen}
        return best_pose(
            ways, lambda way: (views[camera.name].errors(camera, camera.world_to_camera @ way) for camera in seen), most
        )


def best_pose(
    candidates: Sequence[np.ndarray], errors: Callable[[np.ndarray], Iterable[np.ndarray]], most: float
) -> np.ndarray:
    """The pose with the smallest sum over observations of their median error in pixels, which counts `most` at most."""
    costs = [sum(min(most, float(np.median(error))) for error in errors(pose)) for pose in candidates]
    return candidates[int(np.argmin(costs))]


def refine(state: TargetRig, model: str | None, *, principal_point: bool, threads: int) -> TargetRig:
    """Bundle adjustment of intrinsics, camera and target poses, which all need observations; robust loss.
    `threads`: 0 = all cores."""
    world = pycolmap.Reconstruction()
    target = next(iter(state.views.values())).target
    names = list(state.cameras)
    rig = pycolmap.Rig(rig_id=1)
    reference = state.cameras[names[0]].world_to_camera
    for number, name in enumerate(names, 1):
        camera = state.cameras[name]
        own = "OPENCV_FISHEYE" if camera.fisheye else model or USUAL_MODEL
        parameters = model_parameters(camera, own)
        sensor = pycolmap.Camera(
            camera_id=number, model=own, width=camera.width, height=camera.height, params=parameters
        )
        world.add_camera(sensor)
        if number == 1:
            rig.add_ref_sensor(sensor.sensor_id)
        else:
            pose = camera.world_to_camera @ np.linalg.inv(reference)
            rig.add_sensor(sensor.sensor_id, pycolmap.Rigid3d(pose[:3]))
    world.add_rig(rig)
    tracks: dict[int, Any] = {number: pycolmap.Track() for number in range(len(target.corners))}
    config = pycolmap.BundleAdjustmentConfig()
    image_id = 0
    for order, (sync_frame, pose) in enumerate(state.target_poses.items(), 1):
        seen = [(number, name) for number, name in enumerate(names, 1) if (sync_frame, name) in state.views]
        frame = pycolmap.Frame(frame_id=order, rig_id=1)
        pictures = []
        for number, name in seen:
            image_id += 1
            view = state.views[sync_frame, name]
            picture = pycolmap.Image(name=f"{sync_frame}/{name}", camera_id=number, image_id=image_id)
            picture.frame_id = order
            picture.points2D = pycolmap.Point2DList([pycolmap.Point2D(xy) for xy in view.pixels])
            frame.add_data_id(picture.data_id)
            for index, corner in enumerate(view.ids):
                tracks[int(corner)].add_element(image_id, index)
            pictures.append(picture)
        frame.rig_from_world = pycolmap.Rigid3d((reference @ pose)[:3])
        world.add_frame(frame)
        for picture in pictures:
            world.add_image(picture)
            config.add_image(picture.image_id)
        world.register_frame(order)
    for number, corner in enumerate(target.corners):
        if tracks[number].length():
            config.add_constant_point(world.add_point3D(corner, tracks[number]))
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = principal_point
    options.print_summary = False
    # robust, so that motion blur in one sync frame does not affect the others
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.num_threads = threads or os.cpu_count() or 1
    options.ceres.solver_options.function_tolerance = 1e-10
    with logged(_LOG, "COLMAP's bundle adjustment"):
        summary = pycolmap.create_default_bundle_adjuster(options, config, world).solve()
    if not summary.is_solution_usable():
        problem = "the bundle adjustment did not converge"
        raise StudioError("target.bundle_adjustment", problem, fix="Film the target again.")
    return _read(world, state, names, reference)


def _read(world: Any, state: TargetRig, names: list[str], reference: np.ndarray) -> TargetRig:
    cameras = {}
    rig = world.rigs[1]
    for number, name in enumerate(names, 1):
        sensor = world.cameras[number]
        pose = reference
        if number > 1:
            pose = np.vstack([rig.sensor_from_rig(sensor.sensor_id).matrix(), [0, 0, 0, 1]]) @ reference
        lens = intrinsics(sensor.model.name, list(sensor.params))
        cameras[name] = replace(state.cameras[name], world_to_camera=pose, **lens)
    back = np.linalg.inv(reference)
    target_poses = {
        sync_frame: back @ np.vstack([world.frames[order].rig_from_world.matrix(), [0, 0, 0, 1]])
        for order, sync_frame in enumerate(state.target_poses, 1)
    }
    return TargetRig(cameras, target_poses, dict(state.views))
