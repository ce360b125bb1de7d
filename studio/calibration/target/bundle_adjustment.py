"""Bundle adjustment of a rig before a board, by COLMAP.

To COLMAP the board is the world, which stands still, and the cameras are one rig that is carried about it, a frame for
each moment. The corners are known points, so the world is metric and nothing drifts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from studio.calibration.target.pattern import CalibrationTarget, TargetObservation
from studio.camera_files.colmap_model import MODELS, intrinsics
from studio.cameras import Camera
from studio.errors import StudioError


@dataclass
class TargetRig:
    """Cameras, boards and what was seen.

    Attributes:
        cameras: name to camera; `world_to_camera` is from the rig's coordinates.
        boards: moment to (4, 4), from board coordinates to the rig's.
        views: (moment, camera) to what was seen.
    """

    cameras: dict[str, Camera]
    boards: dict[int, np.ndarray]
    views: dict[tuple[int, str], TargetObservation]

    def errors(self, board: CalibrationTarget) -> dict[tuple[int, str], np.ndarray]:
        """Reprojection errors in pixels of each view."""
        found = {}
        for (sync_frame, name), view in self.views.items():
            corners = _apply(self.boards[sync_frame], board.corners[view.ids])
            found[sync_frame, name] = np.linalg.norm(self.cameras[name].project(corners)[0] - view.pixels, axis=1)
        return found


def _apply(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ transform[:3, :3].T + transform[:3, 3]


def refine(
    state: TargetRig,
    board: CalibrationTarget,
    model: str,
    *,
    known: Mapping[str, Camera],
    principal_point: bool,
    threads: int,
) -> TargetRig:
    """All lenses, cameras and boards together, so that the reprojection errors are least (with a robust loss).

    Args:
        state: where to start; every camera and board with at least one view.
        board: its corners.
        model: COLMAP's name of the lens model; lenses that are known keep theirs.
        known: cameras whose lenses stay as they are.
        principal_point: estimate it as well.
        threads: at most.

    Raises:
        StudioError: the adjustment fails.
    """
    import pycolmap

    world = pycolmap.Reconstruction()
    names = list(state.cameras)
    rig = pycolmap.Rig(rig_id=1)
    reference = state.cameras[names[0]].world_to_camera
    for number, name in enumerate(names, 1):
        camera = state.cameras[name]
        lens, parameters = _parameters(camera, model, name in known)
        sensor = pycolmap.Camera(
            camera_id=number, model=lens, width=camera.width, height=camera.height, params=parameters
        )
        world.add_camera(sensor)
        if number == 1:
            rig.add_ref_sensor(sensor.sensor_id)
        else:
            pose = camera.world_to_camera @ np.linalg.inv(reference)
            rig.add_sensor(sensor.sensor_id, pycolmap.Rigid3d(pose[:3]))
    world.add_rig(rig)
    tracks: dict[int, Any] = {number: pycolmap.Track() for number in range(len(board.corners))}
    config = pycolmap.BundleAdjustmentConfig()
    image_id = 0
    for order, (sync_frame, place) in enumerate(state.boards.items(), 1):
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
        frame.rig_from_world = pycolmap.Rigid3d((reference @ place)[:3])
        world.add_frame(frame)
        for picture in pictures:
            world.add_image(picture)
            config.add_image(picture.image_id)
        world.register_frame(order)
    for number, corner in enumerate(board.corners):
        if tracks[number].length():
            config.add_constant_point(world.add_point3D(corner, tracks[number]))
    for number, name in enumerate(names, 1):
        if name in known:
            config.set_constant_cam_intrinsics(number)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = principal_point
    options.print_summary = False
    # a moment in which somebody moved too fast must not pull the rest
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.solver_options.num_threads = max(1, threads)
    options.ceres.solver_options.function_tolerance = 1e-10
    summary = pycolmap.create_default_bundle_adjuster(options, config, world).solve()
    if not summary.is_solution_usable():
        raise StudioError("The bundle adjustment of the boards found no solution; film the board once more.")
    return _read(world, state, names, reference)


def _parameters(camera: Camera, model: str, known: bool) -> tuple[str, list[float]]:
    """The camera's lens in the model asked for; a known lens in whatever model says it."""
    from studio.camera_files.colmap_model import lens_model

    if known:
        return lens_model(camera)
    focal, lens = (camera.fx + camera.fy) / 2, np.zeros(8)
    lens[: camera.distortion.size] = camera.distortion[:8]
    one = model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
    base = [focal, camera.cx, camera.cy] if one else [camera.fx, camera.fy, camera.cx, camera.cy]
    return model, base + lens[: MODELS[model][1] - len(base)].tolist()


def _read(world: Any, state: TargetRig, names: list[str], reference: np.ndarray) -> TargetRig:
    cameras = {}
    rig = world.rigs[1]
    for number, name in enumerate(names, 1):
        sensor = world.cameras[number]
        K, distortion = intrinsics(sensor.model.name, list(sensor.params))
        pose = reference
        if number > 1:
            pose = np.vstack([rig.sensor_from_rig(sensor.sensor_id).matrix(), [0, 0, 0, 1]]) @ reference
        cameras[name] = replace(
            state.cameras[name],
            K=K,
            distortion=distortion if distortion.any() else np.zeros(0),
            world_to_camera=pose,
        )
    back = np.linalg.inv(reference)
    boards = {
        sync_frame: back @ np.vstack([world.frames[order].rig_from_world.matrix(), [0, 0, 0, 1]])
        for order, sync_frame in enumerate(state.boards, 1)
    }
    return TargetRig(cameras, boards, dict(state.views))
