"""Calibration from images: structure from motion with COLMAP, in a child process."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from v3studio.studio.calibration.alignment import align_rigs, compare_rigs, scale_to_distance, upright
from v3studio.studio.calibration.report import CalibrationReport, CameraMotion
from v3studio.studio.calibration.result import CalibrationResult, reprojection_report
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.calibration.sfm.child import run_reporting
from v3studio.studio.calibration.sfm.images import Pictures, write_pictures
from v3studio.studio.calibration.sfm.job import SfmSolution, sfm_job
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import refuse_unknown_cameras
from v3studio.studio.json_types import JsonObject
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.similarity import Similarity

_FOCAL = 1.6  # A focal length is doubtful if its ratio to the median of cameras with the same image size exceeds this

_STEPS = {
    "features": (5, 25),
    "preview": (25, 30),
    "matches": (30, 60),
    "mapping": (60, 85),
    "global mapping": (85, 90),
    "adjusting": (90, 98),
}


def calibrate_from_images(
    images: Mapping[str, Pictures],
    masks: Mapping[str, Pictures] | None = None,
    *,
    workdir: Path | str,
    known: Mapping[str, Camera] | None = None,
    poses: Rig | None = None,
    focal_lengths: Mapping[str, float] | None = None,
    settings: CalibrateSettings | None = None,
    threads: int = 0,
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> CalibrationResult:
    """Estimate the cameras from images of one sync frame, or of several if the cameras do not move.

    Args:
        images: camera name to a raw (H, W, 3) uint8 RGB image with lens distortion, or to a function that reads it, or
            to a list of either, one per sync frame.
        masks: camera name to (H, W) uint8, one per image. Features are detected where the mask is at least 128, or 1 if
            it has only 0 and 1. Cameras without a mask use the whole image.
        workdir: folder for images, database and models; an earlier solution in it is removed.
        known: cameras with known intrinsics (K, distortion); their poses are not used.
        poses: an earlier solution with all the cameras, which may have moved slightly since. Points are triangulated
            from it and the cameras refined, which is much faster; the result is aligned with it. Its intrinsics are
            used for cameras that are not in `known`.
        focal_lengths: initial focal lengths in pixels, for example from EXIF.
        threads: number of threads, 0 = all cores. With one thread, the same seed gives bit-identical results.
        progress: called several times per second; raising `Cancelled` stops COLMAP immediately.

    Returns:
        cameras, sparse points and report. Without `poses`, world coordinates are those of `alignment.upright`: z is
        up, the origin is the point that the cameras look at, and their mean distance from it is 1.

    Raises:
        StudioError: there are too few images (calibration.too_few_images) or unusable ones (see `write_pictures`), a
            setting names another camera (footage.unknown_camera), there is no solution (calibration.no_solution), or
            cameras are not registered (calibration.unregistered, with `unregistered`, camera name to reason).
        Cancelled: from `progress`.
    """
    settings, workdir = settings or CalibrateSettings(), Path(workdir)
    names = list(images)
    if len(names) < 2:
        problem = f"structure from motion needs images of at least 2 cameras, found {len(names)}"
        raise StudioError("calibration.too_few_images", problem, value=len(names), expected=2)
    refuse_unknown_cameras((settings.known_distance or ())[:2], names, "calibrate.known_distance")
    grouped = [name for group in settings.intrinsics_groups for name in group]
    refuse_unknown_cameras(grouped, names, "calibrate.intrinsics_groups")
    for leftover in ("images", "masks", "models", "models_global", "models_known"):
        shutil.rmtree(workdir / leftover, ignore_errors=True)
    for leftover in ("solution.json", "points.npz"):
        (workdir / leftover).unlink(missing_ok=True)
    if poses is not None:
        poses = poses.subset(names)
        known = {**{camera.name: camera for camera in poses}, **(known or {})}
    sizes, sync_frames = write_pictures(workdir, names, images, masks or {}, progress)
    job = sfm_job(
        names, sizes, sync_frames, bool(masks), known or {}, focal_lengths or {}, settings, poses, threads, seed
    )
    path = workdir / "job.json"
    path.write_text(job.model_dump_json(), encoding="utf-8")

    percent = 5

    def relay(step: str, done: int, total: int) -> None:
        nonlocal percent
        if step:
            low, high = _STEPS[step]
            percent = max(percent, low + round((high - low) * done / max(total, 1)))
        progress(percent, 100)

    run_reporting("v3studio.studio.calibration.sfm.worker", [str(path)], relay)
    result = _read(workdir, names, posed=settings.known == "poses")
    transform = _gauge(result, poses, settings)
    update: JsonObject = {"sync_frames": sync_frames}
    if poses is not None:
        update["moved"] = _moved(result, poses, settings)
    report = result.report.model_copy(update=update)
    progress(100, 100)
    return CalibrationResult(transform.rig(result.rig), transform.points(result.points), result.colors, report)


def _moved(result: CalibrationResult, before: Rig, settings: CalibrateSettings) -> dict[str, CameraMotion]:
    """Difference of each camera's pose from that in the earlier solution."""
    if settings.known == "poses" or len(result.rig) < 3:
        return {}
    difference = compare_rigs(result.rig, before)
    return {
        name: CameraMotion(center=round(difference.centers[name], 6), degrees=round(difference.rotations[name], 4))
        for name in difference.centers
    }


def _read(folder: Path, names: Sequence[str], posed: bool) -> CalibrationResult:
    """The worker's solution in COLMAP's gauge. Unless poses are known (`posed`), a camera that sees none of the points
    is not registered: nothing says where it is."""
    solution = SfmSolution.model_validate_json((folder / "solution.json").read_text(encoding="utf-8"))
    with np.load(folder / "points.npz") as arrays:
        points, colors, seen = arrays["points"], arrays["colors"], arrays["observations"]
    seeing = {names[int(number)] for number in np.unique(seen[:, 0])}
    solved = map(Camera.from_dict, solution.cameras)
    cameras = tuple(camera for camera in solved if posed or camera.name in seeing)
    told, known = solution.report, [camera.name for camera in cameras]
    missing = {name: _reason(told.features[name], solution.partners[name]) for name in names if name not in known}
    if len(cameras) < 2:
        worst = min(names, key=lambda name: told.matches[name])
        raise StudioError(
            "calibration.no_solution",
            f"structure from motion found no solution for {len(names)} cameras; camera '{worst}' has the fewest "
            f"matches ({missing.get(worst, 'not registered')})",
            value=len(names),
            fix="Use images that share more of the background, or calibrate from a board (calibrate.board_images) or "
            "from tie points (calibrate.tie_points).",
            camera=worst,
        )
    if missing:
        text = "; ".join(f"'{name}': {reason}" for name, reason in missing.items())
        problem = f"structure from motion registered {len(cameras)} of {len(names)} cameras; not registered: {text}"
        value = sorted(missing)
        fix = "Use another frame (calibrate.frame), several (calibrate.frame_count), or images with more overlap."
        raise StudioError(
            "calibration.unregistered", problem, value=value, fix=fix, unregistered=missing, setting="calibrate.frame"
        )
    rig = Rig(cameras)
    observations = {name: seen[seen[:, 0] == number][:, 1:] for number, name in enumerate(names) if name in known}
    more = dict(told) | {"aspect": round(told.aspect, 6)}
    report = reprojection_report(rig, points, observations, **more)
    return CalibrationResult(rig, points, colors, with_usual_focal(report, rig))


def with_usual_focal(report: CalibrationReport, rig: Rig) -> CalibrationReport:
    """The report, with the usual focal length at cameras whose own is far from it."""
    cameras = dict(report.cameras)
    for camera in rig:
        like = [other.fx for other in rig if (other.width, other.height) == (camera.width, camera.height)]
        usual = float(np.median(like))
        if len(like) > 2 and not 1 / _FOCAL < camera.fx / usual < _FOCAL:
            cameras[camera.name] = cameras[camera.name].model_copy(update={"usual_focal": round(usual, 1)})
    return report.model_copy(update={"cameras": cameras})


def _reason(features: int, best: int) -> str:
    if features < 50:
        return f"only {features} features in its image"
    if best == 0:
        return f"none of its {features} features match another camera"
    return f"at most {best} matches with another camera, too few or not consistent with a pose"


def _gauge(result: CalibrationResult, poses: Rig | None, settings: CalibrateSettings) -> Similarity:
    if poses is not None:
        return Similarity() if settings.known == "poses" else align_rigs(result.rig, poses)
    transform = upright(result.rig, result.points)
    if settings.known_distance is None:
        return transform
    return scale_to_distance(transform.rig(result.rig), *settings.known_distance).after(transform)
