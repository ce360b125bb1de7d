"""Estimates how well the observations determine each camera. Runs in the worker process."""

from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.sfm.bundle_adjustment import problem
from v3studio.studio.calibration.sfm.job import SfmJob
from v3studio.studio.calibration.sfm.verdict import reprojection_errors


def uncertainties(model: Any, job: SfmJob, *, centers: bool) -> dict[int, tuple[float, float]]:
    """1-sigma uncertainty of each registered image: of its position, as a fraction of the mean distance between cameras
    and points, and of its orientation, in degrees. Empty if poses are fixed, or the points do not determine them.

    The covariance of the bundle adjustment, scaled by the misfit (a-posteriori variance factor). It is relative to all
    cameras: the world's position, orientation and scale, best fitted to the centers, are excluded. `centers`: whether
    principal points were estimated.
    """
    images = sorted(model.reg_image_ids())
    errors = reprojection_errors(model)
    freedom = 2 * len(errors) - 3 * len(model.points3D) - 6 * len(images)
    if job.fix_poses or freedom <= 0:
        return {}
    options, config = problem(model, job, centers)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.THREE_POINTS)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    wanted = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.POSES)
    covariances = pycolmap.estimate_ba_covariance(wanted, model, adjuster)
    if covariances is None:
        return {}
    poses = [model.images[image].cam_from_world().matrix() for image in images]
    centers3d = np.array([-pose[:, :3].T @ pose[:, 3] for pose in poses])
    # rows: position and turn of each camera in the world
    slopes, gauge = np.zeros((len(images), 6, 6)), np.zeros((len(images), 6, 7))
    for number, pose in enumerate(poses):
        back = pose[:, :3].T
        slopes[number, :3, :3] = -2 * back @ np.cross(np.eye(3), pose[:, 3])  # Ceres takes half of a turn
        slopes[number, :3, 3:] = -back
        slopes[number, 3:, :3] = -2 * back
        away = centers3d[number] - centers3d.mean(0)
        gauge[number, :3] = np.c_[np.eye(3), -np.cross(np.eye(3), away), away]
        gauge[number, 3:, 3:6] = np.eye(3)
    blocks = [[_covariance(covariances, row, column) for column in images] for row in images]
    if any(block.shape != (6, 6) for row in blocks for block in row):  # of images with too few points
        return {}
    spread = np.einsum("aij,abjk,blk->aibl", slopes, np.array(blocks), slopes).reshape(6 * len(images), -1)
    fit = np.zeros((7, len(images), 6))
    fit[:, :, :3] = np.linalg.pinv(gauge[:, :3].reshape(-1, 7)).reshape(7, len(images), 3)
    own = np.eye(6 * len(images)) - gauge.reshape(-1, 7) @ fit.reshape(7, -1)
    variances = np.einsum("ij,jk,ik->i", own, spread, own).reshape(-1, 2, 3).sum(2) * (errors**2).sum() / freedom
    points = np.array([point.xyz for point in model.points3D.values()])
    distance = np.mean([np.linalg.norm(points - center, axis=1).mean() for center in centers3d])
    sigmas = np.sqrt(np.maximum(variances, 0)) * [1 / distance, np.degrees(1)]
    if not np.isfinite(sigmas).all():
        return {}
    return {image: (float(position), float(turn)) for image, (position, turn) in zip(images, sigmas, strict=True)}


def _covariance(covariances: Any, row: int, column: int) -> np.ndarray:
    """(6, 6) covariance of two images' poses: rotation, then translation, camera from world."""
    if row == column:
        return np.asarray(covariances.get_cam_cov_from_world(row))
    return np.asarray(covariances.get_cam_cross_cov_from_world(row, column))
