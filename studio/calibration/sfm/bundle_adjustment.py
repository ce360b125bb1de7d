"""Bundle adjustment, and models of cameras with known poses. Runs in the worker process."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.sfm.job import SfmJob


def adjust(
    model: Any,
    job: SfmJob,
    *,
    last: bool = True,
    width: float | None = None,
    centers: bool = False,
    keep: bool = False,
) -> None:
    """Bundle adjustment in place.

    Args:
        job: specifies which intrinsics and poses are fixed.
        last: True: squared loss, then filter points with errors over 4 pixels; False: Cauchy loss, 12 pixels.
        width: width of a Cauchy loss in pixels, with up to 100 iterations; None: as determined by `last`.
        centers: also adjust principal points.
        keep: do not filter points.
    """
    options, config = problem(model, job, centers)
    robust = width is not None or not last
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY if robust else pycolmap.LossFunctionType.TRIVIAL
    if width is not None:
        options.ceres.loss_function_scale = width
        # a fifth of the iterations of 1e-12; the error of the cameras is within 2% of that
        solver = options.ceres.solver_options
        solver.max_num_iterations = 100
        solver.function_tolerance = 1e-6
        solver.gradient_tolerance = solver.parameter_tolerance = 1e-12
    if not job.fix_poses:
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    if not keep:  # outliers under the robust loss are not observations
        pycolmap.ObservationManager(model).filter_all_points3D(4.0 if last else 12.0, 1.5)


def problem(model: Any, job: SfmJob, centers: bool) -> tuple[Any, Any]:
    """Options and configuration of a bundle adjustment of all registered images, see `adjust`; the gauge is free."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = centers
    options.refine_rig_from_world = not job.fix_poses
    options.print_summary = False
    options.ceres.solver_options.num_threads = job.threads
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    for index, intrinsics in enumerate(job.intrinsics):
        if intrinsics.fixed:
            config.set_constant_cam_intrinsics(index + 1)
    return options, config


def known_model(path: Path, poses: Sequence[Any]) -> Any:
    """A model without points: the cameras of a database (camera n has image n + 1) at known (3, 4) poses."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(path) as database:
        for camera in database.read_all_cameras():
            model.add_camera(camera)
        for rig in database.read_all_rigs():
            model.add_rig(rig)
        for frame in database.read_all_frames():
            number = next(iter(frame.data_ids)).id - 1
            frame.rig_from_world = pycolmap.Rigid3d(np.array(poses[number], np.float64)[:3])
            model.add_frame(frame)
        for image in database.read_all_images():
            model.add_image(image)
    for frame_id in list(model.frames):
        model.register_frame(frame_id)
    return model
