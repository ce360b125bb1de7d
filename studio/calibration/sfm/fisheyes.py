"""Lenses that are fisheyes although no one told: the scene is mapped again, and each lens is chosen by its error. Runs
in the worker process."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.calibration.initial_intrinsics import may_be_fisheye
from v3studio.studio.calibration.sfm.features import merge_sync_frames, verify
from v3studio.studio.calibration.sfm.focal_lengths import focal_ratio
from v3studio.studio.calibration.sfm.job import SfmJob
from v3studio.studio.calibration.sfm.mapping import Mapper
from v3studio.studio.calibration.sfm.shared_intrinsics import stretched_keypoints
from v3studio.studio.calibration.sfm.verdict import TRUSTED, match_inlier_ratio

_MUCH_WORSE = 2.0  # ratio of the errors of a usual lens and a fisheye from which on it is a fisheye
_BETTER, _MOST_LOST = 0.7, 0.8
"""Error that a solution with fisheyes has at most, and observations at least, as fractions of those with usual lenses:
for eight fisheyes of 130 degrees, 0.3 and 1.04."""
_LEAST = 30  # observations that tell which lens a camera has


def asks_for_fisheyes(mapper: Mapper, model: Any) -> bool:
    """Tell whether a solution with usual lenses leaves doubts that fisheyes may explain."""
    if not _free(mapper.job):
        return False
    if model is None or model.num_reg_images() < len(mapper.job.names):
        return True
    free = [model.cameras[key] for key in mapper.free_cameras() if key in model.cameras]
    barrel = any(may_be_fisheye(focal_ratio(camera), camera.params[camera.extra_params_idxs()]) for camera in free)
    return barrel or match_inlier_ratio(model, mapper.database) < TRUSTED


def with_fisheyes(mapper: Mapper, model: Any, how: str) -> tuple[Mapper, Any, str]:
    """The solution with fisheyes where they fit much better, or the given one."""
    lenses = _free(mapper.job)
    wide, other, other_how = _mapped(mapper, lenses, "wide")
    if other is None:
        return mapper, model, how
    kinds = {mapper.job.intrinsics_of[image - 1]: is_fisheye(other, image) for image in other.reg_image_ids()}
    fisheyes = [index for index in lenses if kinds.get(index)]
    if fisheyes and len(fisheyes) < len(lenses):
        mixed = _mapped(mapper, fisheyes, "mixed")
        if mixed[1] is not None and mixed[1].num_reg_images() >= other.num_reg_images():
            wide, other, other_how = mixed
    if not fisheyes or (model is not None and not is_better(other, model)):
        return mapper, model, how
    return wide, other, f"{other_how}, fisheyes"


def is_better(other: Any, model: Any) -> bool:
    """Tell whether a solution with fisheyes has more images, or a much smaller error, than one with usual lenses."""
    if other.num_reg_images() != model.num_reg_images():
        return bool(other.num_reg_images() > model.num_reg_images())
    kept = other.compute_num_observations() / max(model.compute_num_observations(), 1)
    errors = [each.compute_mean_reprojection_error() for each in (other, model)]
    return bool(kept > _MOST_LOST and errors[0] < _BETTER * errors[1])


def _free(job: SfmJob) -> list[int]:
    return [index for index, own in enumerate(job.intrinsics) if not own.known]


def _mapped(mapper: Mapper, lenses: list[int], name: str) -> tuple[Mapper, Any, str]:
    """Verify the matches anew, with these lenses as fisheyes, and map."""
    folder, job = mapper.folder, mapper.job.with_fisheyes(lenses)
    each, final = Path(folder / "sync_frames.db"), Path(folder / f"{name}.db")
    for leftover in folder.glob(f"{name}*.db*"):
        leftover.unlink()
    own = folder / f"{name}_sync_frames.db"
    shutil.copyfile(each, own)
    if mapper.aspect != 1:  # as a usual lens that did not fit may have had it
        stretched_keypoints(own, 1 / mapper.aspect)
    verify(own, job)
    merge_sync_frames(own, final, job)
    wide = Mapper(folder, final, job)
    wide.sync_frames = own
    return wide, *wide.solve()


def is_fisheye(model: Any, image_id: int) -> bool:
    """Tell whether a usual lens, fitted to what an image observes, has a much larger error than its fisheye."""
    image = model.images[image_id]
    camera = model.cameras[image.camera_id]
    seen = [feature for feature in image.points2D if feature.has_point3D()]
    if len(seen) < _LEAST:
        return False
    points = np.array([model.points3D[feature.point3D_id].xyz for feature in seen])
    pose = np.asarray(image.cam_from_world().matrix())
    local = points @ pose[:, :3].T + pose[:, 3]
    pixels = np.array([feature.xy for feature in seen])
    errors = np.linalg.norm(np.array(camera.img_from_cam(local)) - pixels, axis=1)
    front = (local[:, 2] > 1e-6 * np.abs(local).max(1)) & (errors < 4)
    rays = local[front, :2] / local[front, 2:]
    middle = camera.params[camera.principal_point_idxs()]
    s = (rays**2).sum(1, keepdims=True)
    columns = np.stack([rays, rays * s], axis=-1).reshape(-1, 2)  # of f and f k1
    off = pixels[front] - middle
    solution = np.linalg.lstsq(columns, off.ravel(), rcond=None)[0]
    usual = np.linalg.norm((columns @ solution).reshape(-1, 2) - off, axis=1)
    return bool(np.sqrt(np.mean(usual**2)) > _MUCH_WORSE * np.sqrt(np.mean(errors[front] ** 2)))
