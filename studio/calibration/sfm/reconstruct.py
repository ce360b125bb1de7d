"""Cameras from images: COLMAP's structure from motion, run in a child process."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.alignment import Similarity, align_rigs, compare_rigs, scale_to_distance, upright
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.calibration.settings import CalibrateSettings
from studio.calibration.sfm.child import run_reporting
from studio.calibration.sfm.images import Pictures, write_pictures
from studio.calibration.sfm.job import sfm_job
from studio.calibration.sfm.verdict import TRUSTED
from studio.camera_files.colmap_model import intrinsics
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

_FOCAL = 1.6
"""Factor from the median of like cameras beyond which a focal length is to be looked at."""

_STEPS = {
    "features": (5, 25),
    "glance": (25, 30),
    "matches": (30, 60),
    "mapping": (60, 85),
    "global mapping": (85, 90),
    "adjusting": (90, 98),
}


def calibrate_from_images(
    images: Mapping[str, Pictures],
    masks: Mapping[str, Pictures] | None = None,
    *,
    workdir: Path,
    known: Mapping[str, Camera] | None = None,
    poses: Rig | None = None,
    focal_lengths: Mapping[str, float] | None = None,
    settings: CalibrateSettings | None = None,
    threads: int = 0,
    seed: int = 0,
    allow_unregistered: bool = False,
    reference: Rig | None = None,
    distance: tuple[str, str, float] | None = None,
    progress: ProgressFn = no_progress,
) -> CalibrationResult:
    """Find cameras from their images: of one moment, of several while the cameras stand still, or of a thing that does.

    Args:
        images: camera name to (H, W, 3) uint8 RGB, as in the files (with lens distortion); or to one for each of
            several moments, or functions that read them.
        masks: camera name to (H, W) uint8, a moment each as the images; features are looked for where it is at least
            128 (not 0, where it holds 0 and 1 only). Cameras without one use all.
        workdir: a folder for images, database and models; an old solution in it is removed.
        known: cameras whose lenses (K, distortion) are known; their poses are not used.
        poses: an older solution of all these cameras: where they stand, or stood until somebody touched them. Features
            are then triangulated and the cameras adjusted, which takes a fraction of the time; the result stays on the
            old one as well as it can. Its lenses are used where `known` has none.
        focal_lengths: first guesses in pixels, from EXIF say.
        settings: how to solve.
        threads: CPU threads; 0: all cores. With one thread, the same seed gives the same result bit for bit.
        seed: of all random choices.
        allow_unregistered: go on without cameras that find no place (they stand in the report) instead of raising.
        reference: put the result where this rig is (by camera centers, at least three in common).
        distance: two cameras and how far apart they are, to fix the scale.
        progress: called several times a second; `Cancelled` raised from it stops COLMAP at once.

    Returns:
        cameras, sparse points and figures. Without a reference the world is `gauge.upright`'s: z up, the origin where
        the cameras look, mean distance of the cameras 1.

    Raises:
        StudioError: too few or unusable images, no solution, or cameras without a place: named, with the reason.
        Cancelled: from progress.
    """
    settings = settings or CalibrateSettings()
    started = time.monotonic()
    names = list(images)
    if len(names) < 2:
        raise StudioError(f"Structure from motion needs at least two images, found {len(names)}.")
    folder = Path(workdir)
    for leftover in ("images", "masks", "models", "models_global", "models_known"):
        shutil.rmtree(folder / leftover, ignore_errors=True)
    for leftover in ("solution.json", "points.npz"):
        (folder / leftover).unlink(missing_ok=True)
    if poses is not None:
        poses = poses.subset(names)
        known = {**{camera.name: camera for camera in poses}, **(known or {})}
    sizes, sync_frames = write_pictures(folder, names, images, masks or {}, progress)
    job = sfm_job(
        names, sizes, sync_frames, bool(masks), known or {}, focal_lengths or {}, settings, poses, threads, seed
    )
    path = folder / "job.json"
    path.write_text(json.dumps(job))

    at = {"done": 5}

    def relay(line: dict[str, Any]) -> None:
        if line:
            low, high = _STEPS.get(line["step"], (90, 98))
            at["done"] = max(at["done"], low + round((high - low) * line["done"] / max(line["total"], 1)))
        progress(at["done"], 100)

    run_reporting("studio.calibration.sfm.worker", [str(path)], relay, what="Structure from motion")
    result = _read(folder, names, sizes, allow_unregistered)
    result.report["sync_frames"] = sync_frames
    if poses is not None:
        result.report["moved"] = _moved(result, poses, settings)
    kept = poses is not None and reference is None and settings.fix_poses
    transform = _gauge(result, reference if reference is not None else poses, distance, kept)
    result = replace(result, rig=transform.rig(result.rig), points=transform.points(result.points))
    result.report["seconds"] = round(time.monotonic() - started, 1)
    progress(100, 100)
    return result


def _moved(result: CalibrationResult, before: Rig, settings: CalibrateSettings) -> dict[str, dict[str, float]]:
    """How far each camera is from where it stood in the older solution: center (in its units) and degrees."""
    if settings.fix_poses or len(result.rig) < 3:
        return {}
    difference = compare_rigs(result.rig, before)
    return {
        name: {"center": round(difference.centers[name], 6), "degrees": round(difference.rotations[name], 4)}
        for name in difference.centers
    }


def _read(
    folder: Path, names: Sequence[str], sizes: Mapping[str, tuple[int, int]], allow_unregistered: bool
) -> CalibrationResult:
    """The child's solution in COLMAP's own gauge."""
    solution = json.loads((folder / "solution.json").read_text())
    with np.load(folder / "points.npz") as arrays:
        points, colors, seen = arrays["points"], arrays["colors"], arrays["observations"]
    features = {name: int(solution["features"][str(number)]) for number, name in enumerate(names)}
    matches = dict.fromkeys(names, 0)
    partners = dict.fromkeys(names, 0)
    for first, second, count in solution["pairs"]:
        for number in (first, second):
            matches[names[number]] += count
            partners[names[number]] = max(partners[names[number]], count)
    found: dict[int, Camera] = {}
    for entry in solution["cameras"]:
        number = int(entry["number"])
        width, height = sizes[names[number]]
        K, distortion = intrinsics(entry["model"], entry["params"])
        pose = np.vstack([np.array(entry["pose"]), [0, 0, 0, 1]])
        found[number] = Camera(names[number], width, height, K, pose, distortion if distortion.any() else np.zeros(0))
    missing = {
        name: _reason(features[name], partners[name]) for number, name in enumerate(names) if number not in found
    }
    if len(found) < 2:
        worst = min(names, key=lambda name: matches[name])
        raise StudioError(
            f"Structure from motion found no solution for these {len(names)} images; fewest matches has '{worst}' "
            f"({missing.get(worst, 'no place')}); use images with more of the same background in view, or calibrate "
            "with a board, or from points that you mark by hand (calibrate.tie_points)."
        )
    if missing and not allow_unregistered:
        text = "; ".join(f"'{name}': {reason}" for name, reason in missing.items())
        raise StudioError(
            f"Structure from motion placed {len(found)} of {len(names)} cameras, not {text}; take another moment or "
            "images with more overlap, or allow the calibration to go on without them."
        )
    rig = Rig(tuple(found[number] for number in sorted(found)))
    observations = {names[n]: seen[seen[:, 0] == n][:, 1:] for n in found}
    report = reprojection_report(rig, points, observations)
    report |= {"unregistered": missing, "mapper": solution["mapper"], "features": features, "matches": matches}
    report["match_inlier_ratio"] = solution["match_inlier_ratio"]
    _judge(report, rig)
    report["sharing"] = [
        {**each, "images": [names[number] for number in each["images"]]} for each in solution["sharing"]
    ]
    return CalibrationResult(rig, points, colors, report)


def _judge(report: dict[str, Any], rig: Rig) -> None:
    """A small reprojection error is no good calibration where matches disagree or focal lengths cannot be."""
    if report["match_inlier_ratio"] < TRUSTED:
        report["quality"] = "review"
    for camera in rig:
        like = [other.fx for other in rig if (other.width, other.height) == (camera.width, camera.height)]
        usual = float(np.median(like))
        if len(like) > 2 and not 1 / _FOCAL < camera.fx / usual < _FOCAL:
            report["cameras"][camera.name] |= {"quality": "review", "usual_focal": round(usual, 1)}
            report["quality"] = "review"


def _reason(features: int, best: int) -> str:
    if features < 50:
        return f"only {features} features were found in its image"
    if best == 0:
        return f"none of its {features} features could be matched with another camera"
    return f"its best pair shares only {best} matches, or they fit no common pose"


def _gauge(
    result: CalibrationResult, reference: Rig | None, distance: tuple[str, str, float] | None, kept: bool
) -> Similarity:
    if reference is not None and kept:
        return Similarity(1.0, np.eye(3), np.zeros(3))
    if reference is not None:
        return align_rigs(result.rig, reference)
    transform = upright(result.rig, result.points)
    if distance is not None:
        scaling = scale_to_distance(transform.rig(result.rig), *distance)
        return Similarity(transform.scale * scaling.scale, transform.rotation, transform.translation * scaling.scale)
    return transform
