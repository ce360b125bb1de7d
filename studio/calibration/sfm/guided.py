"""Matches along the epipolar lines of a solved rig. Runs in the worker process.

Without a rig, a feature is compared with all of another image, and is ambiguous if two of these look alike, as in a
room that repeats. Near its epipolar line there are few, so more features have a match.
"""

import shutil
import sqlite3
from contextlib import closing
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from v3studio.studio.calibration.sfm.job import SfmJob

_ANGLE, _RATIO = 0.7, 0.8
"""Largest angle between descriptors in radians, and compared with the second best; as in COLMAP."""
_WIDEST = 80.0  # views further apart in degrees are not matched
_FEWEST = 8


def write_guided_matches(each: Path, merged: Path, out: Path, model: Any, job: SfmJob, band: float) -> None:
    """Copy the database `merged` with the matches that the cameras of `model` guide instead.

    Args:
        each: the database with the descriptors of each sync frame; `merged` has their keypoints, see
            `features.merge_sync_frames`.
        band: largest Sampson distance in pixels.
    """
    shutil.copyfile(merged, out)
    with closing(sqlite3.connect(out)) as connection, connection:
        connection.execute("DELETE FROM matches")
        connection.execute("DELETE FROM two_view_geometries")
    images = sorted(model.reg_image_ids())
    cameras = {image: model.cameras[model.images[image].camera_id] for image in images}
    poses = {image: model.images[image].cam_from_world().matrix() for image in images}
    codes: dict[int, list[np.ndarray]] = {image: [] for image in images}
    rays: dict[int, list[np.ndarray]] = {image: [] for image in images}
    with pycolmap.Database.open(each) as source:
        for image in images:
            for picture in range((image - 1) * job.sync_frames + 1, image * job.sync_frames + 1):
                descriptors = source.read_descriptors(picture).data.astype(np.float32)
                codes[image].append(descriptors / np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1e-9))
                pixels = np.asarray(source.read_keypoints(picture))[:, :2].astype(np.float64)
                rays[image].append(np.c_[cameras[image].cam_from_img(pixels), np.ones(len(pixels))].astype(np.float32))
    with pycolmap.Database.open(out) as target:
        for first, second in combinations(images, 2):
            if poses[first][2, :3] @ poses[second][2, :3] < np.cos(np.radians(_WIDEST)):
                continue
            turn = poses[second][:, :3] @ poses[first][:, :3].T
            shift = poses[second][:, 3] - turn @ poses[first][:, 3]
            essential = (np.cross(np.eye(3), shift) @ turn).astype(np.float32)
            width = 2 * band / (cameras[first].mean_focal_length() + cameras[second].mean_focal_length())
            together, start = [], np.zeros(2, int)
            for a, b, ray, other in zip(codes[first], codes[second], rays[first], rays[second], strict=True):
                lines, back = ray @ essential.T, other @ essential
                slopes = (lines[:, :2] ** 2).sum(1)[:, None] + (back[:, :2] ** 2).sum(1)
                together.append(_best(np.where((lines @ other.T) ** 2 < width**2 * slopes, a @ b.T, -1)) + start)
                start += (len(a), len(b))
            matches = np.concatenate(together).astype(np.uint32)
            if len(matches) >= _FEWEST:
                geometry = pycolmap.TwoViewGeometry()
                geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
                geometry.inlier_matches = matches
                target.write_matches(first, second, matches)
                target.write_two_view_geometry(first, second, geometry)


def _best(cosines: np.ndarray) -> np.ndarray:
    """(M, 2) indices of the mutual best that are much better than the second best; `cosines` is overwritten."""
    if not cosines.size:
        return np.zeros((0, 2), int)
    first, second = np.arange(len(cosines)), cosines.argmax(1)
    best = cosines[first, second]
    kept = (cosines.argmax(0)[second] == first) & (best > np.cos(_ANGLE))
    first, second, best = first[kept], second[kept], best[kept]
    cosines[first, second] = -1
    next_best = np.maximum(cosines[first].max(1, initial=-1), cosines[:, second].max(0, initial=-1))
    clear = np.arccos(np.minimum(best, 1)) < _RATIO * np.arccos(np.clip(next_best, 0, 1))
    return np.c_[first, second][clear]
