"""Cameras from images: COLMAP's structure from motion, run in a child process."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.child import run_reporting
from studio.calibration.gauge import Similarity, align_rigs, scale_to_distance, upright
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.camera_files.colmap_model import intrinsics, lens_model
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

_START = {  # parameters from focal length f and principal point
    "SIMPLE_PINHOLE": lambda f, cx, cy: [f, cx, cy],
    "PINHOLE": lambda f, cx, cy: [f, f, cx, cy],
    "SIMPLE_RADIAL": lambda f, cx, cy: [f, cx, cy, 0.0],
    "RADIAL": lambda f, cx, cy: [f, cx, cy, 0.0, 0.0],
    "OPENCV": lambda f, cx, cy: [f, f, cx, cy, 0.0, 0.0, 0.0, 0.0],
    "FULL_OPENCV": lambda f, cx, cy: [f, f, cx, cy] + [0.0] * 8,
}
_STEPS = {"features": (5, 25), "matches": (25, 60), "mapping": (60, 90), "global mapping": (90, 97)}


@dataclass(frozen=True)
class SfmSettings:
    """How to solve.

    Attributes:
        lens: COLMAP model of lenses that are not known: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL (one focal length, one
            radial term), RADIAL, OPENCV or FULL_OPENCV.
        shared_lens: all cameras have one lens in common (one camera carried about, or lenses locked alike). Images of
            different size never share one.
        focal_factor: first guess of unknown focal lengths, in longer image sides.
        refine_principal_point: estimate it too; needs many well spread points.
        keep_known: lenses given are kept; else they are where refinement begins.
        max_features: a camera, at most.
        max_image_size: longer side in pixels above which features are found in a reduced image.
        guided: match again along the epipolar lines; more matches, longer.
        mapper: "incremental", "global", or "auto": incremental, then with weaker demands, then global, until all
            cameras stand.
        threads: 0 = all cores. One thread gives the same result, bit for bit, for the same seed.
        seed: of everything random.
    """

    lens: str = "SIMPLE_RADIAL"
    shared_lens: bool = False
    focal_factor: float = 1.2
    refine_principal_point: bool = False
    keep_known: bool = True
    max_features: int = 8192
    max_image_size: int = 2400
    guided: bool = False
    mapper: str = "auto"
    threads: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.lens not in _START:
            raise StudioError(f"The lens model '{self.lens}' is unknown; choose one of {', '.join(_START)}.")
        if self.mapper not in ("auto", "incremental", "global"):
            raise StudioError(f"The mapper '{self.mapper}' is unknown; choose auto, incremental or global.")
        if self.threads < 0 or self.max_features < 100 or self.max_image_size < 64 or not self.focal_factor > 0:
            raise StudioError(
                "Calibration needs threads >= 0, max_features >= 100, max_image_size >= 64 and focal_factor > 0."
            )


def calibrate_from_images(
    images: Mapping[str, np.ndarray],
    masks: Mapping[str, np.ndarray] | None = None,
    *,
    workdir: Path,
    known: Mapping[str, Camera] | None = None,
    focal_lengths: Mapping[str, float] | None = None,
    settings: SfmSettings | None = None,
    allow_unregistered: bool = False,
    reference: Rig | None = None,
    distance: tuple[str, str, float] | None = None,
    progress: ProgressFn = no_progress,
) -> CalibrationResult:
    """Find the cameras of one moment (or of a thing that stands still) from their images.

    Args:
        images: camera name to (H, W, 3) uint8 RGB, as in the files (with lens distortion).
        masks: camera name to (H, W) uint8; features are looked for where it is at least 128 (not 0,
            where it holds 0 and 1 only). Cameras without one use all.
        workdir: a folder for images, database and models; an old solution in it is removed.
        known: cameras whose lenses (K, distortion) are known; their poses are not used.
        focal_lengths: first guesses in pixels, from EXIF say.
        settings: how to solve.
        allow_unregistered: go on without cameras that find no place (they stand in the report) instead of raising.
        reference: put the result where this rig is (by camera centres, at least three in common).
        distance: two cameras and how far apart they are, to fix the scale.
        progress: called several times a second; `Cancelled` raised from it stops COLMAP at once.

    Returns:
        cameras, sparse points and figures. Without a reference the world is `gauge.upright`'s: z up, the origin where
        the cameras look, mean distance of the cameras 1.

    Raises:
        StudioError: too few or unusable images, no solution, or cameras without a place: named, with the reason.
        Cancelled: from progress.
    """
    settings = settings or SfmSettings()
    started = time.monotonic()
    names = list(images)
    if len(names) < 2:
        raise StudioError(f"Structure from motion needs at least two images, found {len(names)}.")
    folder = Path(workdir)
    for leftover in ("images", "masks", "models", "models_global"):
        shutil.rmtree(folder / leftover, ignore_errors=True)
    for leftover in ("solution.json", "points.npz"):
        (folder / leftover).unlink(missing_ok=True)
    _write_images(folder, names, images, masks or {}, progress)
    job = _job(names, images, bool(masks), known or {}, focal_lengths or {}, settings)
    path = folder / "job.json"
    path.write_text(json.dumps(job))

    at = {"done": 5}

    def relay(line: dict[str, Any]) -> None:
        if line:
            low, high = _STEPS.get(line["step"], (90, 97))
            at["done"] = max(at["done"], low + round((high - low) * line["done"] / max(line["total"], 1)))
        progress(at["done"], 100)

    run_reporting("studio.calibration.sfm_worker", [str(path)], relay, what="Structure from motion")
    result = _read(folder, names, images, allow_unregistered)
    transform = _gauge(result, reference, distance)
    result = replace(result, rig=transform.rig(result.rig), points=transform.points(result.points))
    result.report["seconds"] = round(time.monotonic() - started, 1)
    progress(100, 100)
    return result


def _write_images(
    folder: Path,
    names: Sequence[str],
    images: Mapping[str, np.ndarray],
    masks: Mapping[str, np.ndarray],
    progress: ProgressFn,
) -> None:
    import cv2

    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(names):
        image = np.asarray(images[name])
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise StudioError(f"Camera '{name}': the image must be (H, W, 3) uint8, found {image.shape} {image.dtype}.")
        mask = masks.get(name)
        if mask is None:
            mask = np.full(image.shape[:2], 255, np.uint8)
        if mask.shape != image.shape[:2]:
            raise StudioError(
                f"Camera '{name}': the mask is {mask.shape[1]}x{mask.shape[0]}, the image "
                f"{image.shape[1]}x{image.shape[0]}; give masks of the image's size."
            )
        usable = mask >= (1 if mask.max() <= 1 else 128)
        if not usable.any():
            raise StudioError(f"Camera '{name}': the mask leaves nothing of the image to find features in; mend it.")
        fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
        files = {folder / "images" / f"{number:04d}.png": image[:, :, ::-1]}
        if masks:
            files[folder / "masks" / f"{number:04d}.png.png"] = usable.astype(np.uint8) * 255
        for path, pixels in files.items():
            if not cv2.imwrite(str(path), np.ascontiguousarray(pixels), fast):
                raise StudioError(f"{path}: cannot be written; check the disk and the permissions.")
        progress(round(5 * (number + 1) / len(names)), 100)


def _job(
    names: Sequence[str],
    images: Mapping[str, np.ndarray],
    masks: bool,
    known: Mapping[str, Camera],
    focal_lengths: Mapping[str, float],
    settings: SfmSettings,
) -> dict[str, Any]:
    lenses: list[dict[str, Any]] = []
    lens_of: list[int] = []
    shared: dict[tuple[int, int], int] = {}
    for name in names:
        height, width = images[name].shape[:2]
        if name in known:
            camera = known[name]
            if (camera.width, camera.height) != (width, height):
                raise StudioError(
                    f"Camera '{name}': the image is {width}x{height} but the known lens is for "
                    f"{camera.width}x{camera.height}; scale one of them."
                )
            model, parameters = lens_model(camera)
            lens = {"model": model, "params": parameters, "prior": True, "known": True}
        else:
            if settings.shared_lens and (width, height) in shared:
                lens_of.append(shared[width, height])
                continue
            shared[width, height] = len(lenses)
            focal = focal_lengths.get(name, settings.focal_factor * max(width, height))
            parameters = _START[settings.lens](float(focal), width / 2, height / 2)
            lens = {"model": settings.lens, "params": parameters, "prior": name in focal_lengths, "known": False}
        lens_of.append(len(lenses))
        lenses.append({**lens, "width": width, "height": height})
    return {
        "names": list(names),
        "lenses": lenses,
        "lens_of": lens_of,
        "masks": masks,
        "max_features": settings.max_features,
        "max_image_size": settings.max_image_size,
        "guided": settings.guided,
        "mapper": settings.mapper,
        "seed": settings.seed,
        "threads": settings.threads or os.cpu_count() or 1,
        "keep_known": settings.keep_known,
        "refine_principal_point": settings.refine_principal_point,
    }


def _read(
    folder: Path, names: Sequence[str], images: Mapping[str, np.ndarray], allow_unregistered: bool
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
        height, width = images[names[number]].shape[:2]
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
            "with a board."
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
    return CalibrationResult(rig, points, colors, report)


def _reason(features: int, best: int) -> str:
    if features < 50:
        return f"only {features} features were found in its image"
    if best == 0:
        return f"none of its {features} features could be matched with another camera"
    return f"its best pair shares only {best} matches, or they fit no common pose"


def _gauge(result: CalibrationResult, reference: Rig | None, distance: tuple[str, str, float] | None) -> Similarity:
    if reference is not None:
        return align_rigs(result.rig, reference)
    transform = upright(result.rig, result.points)
    if distance is not None:
        scaling = scale_to_distance(transform.rig(result.rig), *distance)
        return Similarity(transform.scale * scaling.scale, transform.rotation, transform.translation * scaling.scale)
    return transform
