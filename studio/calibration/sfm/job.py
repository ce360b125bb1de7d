"""Structure from motion: settings, and the models of the worker process's job and solution files."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from v3studio.studio.calibration.initial_intrinsics import initial_camera
from v3studio.studio.calibration.report import SolutionReport
from v3studio.studio.calibration.settings import USUAL_MODEL, CalibrateSettings
from v3studio.studio.camera_files.colmap_model import camera_model, model_parameters
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.json_types import JsonObject

MAX_FEATURES = 8192  # per image
_NEAREST, _WIDEST = 10, 80.0  # cameras with which each is matched if poses are known; degrees between their views
_FOCAL_FACTOR = 1.2  # initial focal length where none is known, as a multiple of the longer side
_SIMPLER = dict.fromkeys(("RADIAL", "OPENCV", "FULL_OPENCV"), "SIMPLE_RADIAL")
_SIMPLER["OPENCV_FISHEYE"] = "SIMPLE_RADIAL_FISHEYE"
"""Camera models used during mapping; the remaining terms are estimated afterwards."""
_FISHEYE_FACTOR = 0.5  # initial focal length of a fisheye, as a multiple of the longer side


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SfmCamera(_Model):
    """Intrinsics of one or more images."""

    model: str  # COLMAP camera model used during mapping
    width: int
    height: int
    params: tuple[float, ...]  # parameters of the model, pixels
    prior: bool = False  # whether the focal length is known at least approximately
    known: bool = False  # whether the intrinsics are known
    fixed: bool = False  # whether they are kept
    becomes: str | None = None  # camera model of the result, for estimated intrinsics


class SfmJob(_Model):
    """Input of the worker process, job.json."""

    names: tuple[str, ...]  # camera names; image n + 1 of the database belongs to camera n
    sync_frames: int = 1  # images per camera
    intrinsics: tuple[SfmCamera, ...]
    intrinsics_of: tuple[int, ...]  # index into `intrinsics` for each camera
    masks: bool = False  # whether there are mask images
    pairs: tuple[tuple[int, int], ...] = ()  # pairs of cameras to match; empty for all
    poses: tuple[tuple[tuple[float, ...], ...], ...] = ()
    """World-to-camera matrices (3, 4) of all cameras from an earlier solution, or empty."""
    fix_poses: bool = False
    max_features: int = MAX_FEATURES
    attempts: tuple[str, ...] = ("incremental", "lenient", "global")
    """Ways of mapping, tried in this order until all cameras are registered."""
    seed: int = 0
    threads: int = 1
    find_shared: bool = False  # whether to test if cameras share intrinsics
    find_wide: bool = False  # whether to test if unknown lenses are fisheyes

    def with_fisheyes(self, lenses: Collection[int]) -> SfmJob:
        """The job in which the intrinsics with these indices are those of fisheyes."""
        wide = list(self.intrinsics)
        for index in lenses:
            width, height = wide[index].width, wide[index].height
            update: JsonObject = {
                "model": _SIMPLER["OPENCV_FISHEYE"],
                "params": (_FISHEYE_FACTOR * max(width, height), width / 2, height / 2, 0.0),
                "prior": True,
                "becomes": "OPENCV_FISHEYE",
            }
            wide[index] = wide[index].model_copy(update=update)
        return self.model_copy(update={"intrinsics": tuple(wide)})


class SfmSolution(_Model):
    """Output of the worker process, solution.json; points and observations are in points.npz."""

    cameras: tuple[JsonObject, ...]  # `Camera.to_dict` of the registered cameras, in COLMAP's gauge
    partners: dict[str, int]  # camera to its largest number of verified matches with another one
    report: SolutionReport


def sfm_job(
    names: Sequence[str],
    sizes: Mapping[str, tuple[int, int]],
    sync_frames: int,
    masks: bool,
    known: Mapping[str, Camera],
    focal_lengths: Mapping[str, float],
    settings: CalibrateSettings,
    poses: Rig | None,
    threads: int,
    seed: int,
) -> SfmJob:
    """The job for `sfm.worker`.

    Args:
        sizes: (width, height) of each camera's images.
        focal_lengths: camera name to an initial focal length in pixels.
        poses: an earlier solution with all the cameras, or None.

    Raises:
        StudioError: known intrinsics are for another image size (calibration.intrinsics_size).
    """
    intrinsics: list[SfmCamera] = []
    intrinsics_of: list[int] = []
    shared: dict[tuple[int, int, int], int] = {}
    groups = {name: index for index, group in enumerate(settings.intrinsics_groups) for name in group}
    for name in names:
        width, height = sizes[name]
        key = (groups.get(name, -1), width, height)
        wanted = settings.camera_model or USUAL_MODEL
        factor = _FISHEYE_FACTOR if wanted == "OPENCV_FISHEYE" else _FOCAL_FACTOR
        start = initial_camera(name, sizes[name], known, focal_lengths, factor)
        if name in known:
            model, parameters = camera_model(start)
            own = SfmCamera(
                model=model,
                width=width,
                height=height,
                params=tuple(parameters),
                prior=True,
                known=True,
                fixed=settings.known != "initial_intrinsics",
            )
        else:
            if (settings.shared_intrinsics or name in groups) and key in shared:
                intrinsics_of.append(shared[key])
                continue
            shared[key] = len(intrinsics)
            # distortion terms that the first few matches do not determine would distort the poses during mapping
            model = _SIMPLER.get(wanted, wanted)
            own = SfmCamera(
                model=model,
                width=width,
                height=height,
                params=tuple(model_parameters(start, model)),
                prior=name in focal_lengths or wanted == "OPENCV_FISHEYE",  # estimates before mapping are for pinholes
                becomes=wanted,
            )
        intrinsics_of.append(len(intrinsics))
        intrinsics.append(own)
    return SfmJob(
        names=tuple(names),
        sync_frames=sync_frames,
        intrinsics=tuple(intrinsics),
        intrinsics_of=tuple(intrinsics_of),
        masks=masks,
        pairs=tuple(neighbors(poses)) if poses is not None else (),
        poses=tuple(camera.world_to_camera[:3].tolist() for camera in poses) if poses is not None else (),
        fix_poses=settings.known == "poses",
        max_features=MAX_FEATURES,
        seed=seed,
        threads=threads or os.cpu_count() or 1,
        find_shared=settings.shared_intrinsics is None and not settings.intrinsics_groups,
        find_wide=settings.camera_model is None and poses is None,
    )


def neighbors(rig: Rig) -> list[tuple[int, int]]:
    """Sorted pairs of cameras worth matching: each with the nearest that look in a similar direction."""
    centers = rig.centers
    forward = np.array([camera.forward for camera in rig])
    angles = np.degrees(np.arccos(np.clip(forward @ forward.T, -1, 1)))
    pairs = set()
    for index in range(len(rig)):
        order = np.argsort(np.linalg.norm(centers - centers[index], axis=1), kind="stable")
        near = [int(other) for other in order if other != index and angles[index, other] <= _WIDEST]
        pairs |= {(min(index, other), max(index, other)) for other in near[:_NEAREST]}
    return sorted(pairs)


def file_name(number: int, sync_frame: int = 0) -> str:
    """Name of the image of a camera and a sync frame. The database for mapping has one image per camera, named after
    the first sync frame, whose colors COLMAP gives to the points."""
    return f"{number:04d}.png" if sync_frame == 0 else f"{number:04d}_{sync_frame:03d}.png"
