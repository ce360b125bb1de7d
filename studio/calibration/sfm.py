"""Cameras from images: COLMAP's structure from motion, run in a child process."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from studio.calibration.child import run_reporting
from studio.calibration.gauge import Similarity, align_rigs, compare_rigs, scale_to_distance, upright
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.calibration.sfm_features import file_name
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
_SIMPLER = dict.fromkeys(("RADIAL", "OPENCV", "FULL_OPENCV"), "SIMPLE_RADIAL")
"""With which lenses the cameras are put together before the other terms are solved for."""

Picture = np.ndarray | Callable[[], np.ndarray]
"""(H, W, 3) uint8 RGB, or what reads it when it is needed."""
Pictures = np.ndarray | Sequence[Picture]
"""A camera's picture, or its pictures of several moments, the same moments for all cameras."""

_STEPS = {
    "features": (5, 25),
    "matches": (25, 60),
    "mapping": (60, 85),
    "global mapping": (85, 90),
    "adjusting": (90, 98),
}


@dataclass(frozen=True)
class SfmSettings:
    """How to solve.

    Attributes:
        lens: COLMAP model of lenses that are not known: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL (one focal length, one
            radial term), RADIAL, OPENCV or FULL_OPENCV.
        shared_lens: all cameras have one lens in common (one camera carried about, or lenses locked alike); False: each
            has its own; None: the footage decides, see `sfm_lenses`. Images of different size never share one.
        focal_factor: first guess of unknown focal lengths, in longer image sides.
        refine_principal_point: estimate it too; needs many well spread points.
        lens_groups: names of cameras that have one lens in common, a tuple a group; cameras in none have their own.
        keep_known: lenses given are kept; else they are where refinement begins.
        keep_poses: poses given are kept; else they are where refinement begins.
        max_features: a camera, at most.
        max_image_size: longer side in pixels above which features are found in a reduced image.
        guided: match again along the epipolar lines; more matches, longer.
        mapper: "incremental", "global", or "auto": incremental, then with weaker demands, then global, until all
            cameras stand.
        threads: 0 = all cores. One thread gives the same result, bit for bit, for the same seed.
        seed: of everything random.
    """

    lens: str = "SIMPLE_RADIAL"
    shared_lens: bool | None = None
    lens_groups: tuple[tuple[str, ...], ...] = ()
    focal_factor: float = 1.2
    refine_principal_point: bool = False
    keep_known: bool = True
    keep_poses: bool = False
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
    images: Mapping[str, Pictures],
    masks: Mapping[str, Pictures] | None = None,
    *,
    workdir: Path,
    known: Mapping[str, Camera] | None = None,
    poses: Rig | None = None,
    focal_lengths: Mapping[str, float] | None = None,
    settings: SfmSettings | None = None,
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
    for leftover in ("images", "masks", "models", "models_global", "models_known"):
        shutil.rmtree(folder / leftover, ignore_errors=True)
    for leftover in ("solution.json", "points.npz"):
        (folder / leftover).unlink(missing_ok=True)
    if poses is not None:
        poses = poses.subset(names)
        known = {**{camera.name: camera for camera in poses}, **(known or {})}
    sizes, moments = _write_images(folder, names, images, masks or {}, progress)
    job = _job(names, sizes, moments, bool(masks), known or {}, focal_lengths or {}, settings, poses)
    path = folder / "job.json"
    path.write_text(json.dumps(job))

    at = {"done": 5}

    def relay(line: dict[str, Any]) -> None:
        if line:
            low, high = _STEPS.get(line["step"], (90, 98))
            at["done"] = max(at["done"], low + round((high - low) * line["done"] / max(line["total"], 1)))
        progress(at["done"], 100)

    run_reporting("studio.calibration.sfm_worker", [str(path)], relay, what="Structure from motion")
    result = _read(folder, names, sizes, allow_unregistered)
    result.report["moments"] = moments
    if poses is not None:
        result.report["moved"] = _moved(result, poses, settings)
    kept = poses is not None and reference is None and settings.keep_poses
    transform = _gauge(result, reference if reference is not None else poses, distance, kept)
    result = replace(result, rig=transform.rig(result.rig), points=transform.points(result.points))
    result.report["seconds"] = round(time.monotonic() - started, 1)
    progress(100, 100)
    return result


def _read_picture(picture: Any) -> np.ndarray:
    return np.asarray(picture() if callable(picture) else picture)


def _list(pictures: Any) -> list[Any]:
    return [pictures] if isinstance(pictures, np.ndarray) or callable(pictures) else list(pictures)


def _write_images(
    folder: Path,
    names: Sequence[str],
    images: Mapping[str, Pictures],
    masks: Mapping[str, Pictures],
    progress: ProgressFn,
) -> tuple[dict[str, tuple[int, int]], int]:
    """PNG files for COLMAP; (width, height) of each camera's, and how many moments there are."""
    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    counts = {name: len(_list(images[name])) for name in names}
    moments = counts[names[0]]
    for name, count in counts.items():
        if count != moments:
            raise StudioError(f"Camera '{name}' has pictures of {count} moments, '{names[0]}' of {moments}.")
    sizes: dict[str, tuple[int, int]] = {}
    for number, name in enumerate(names):
        own = _list(masks[name]) if name in masks else [None] * moments
        if len(own) != moments:
            raise StudioError(f"Camera '{name}' has {len(own)} masks for {moments} pictures; give a mask a picture.")
        usable = False
        for moment, (picture, mask) in enumerate(zip(_list(images[name]), own, strict=True)):
            image = _read_picture(picture)
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
                raise StudioError(
                    f"Camera '{name}': the image must be (H, W, 3) uint8, found {image.shape} {image.dtype}."
                )
            size = (image.shape[1], image.shape[0])
            if sizes.setdefault(name, size) != size:
                raise StudioError(f"Camera '{name}': its pictures differ in size ({sizes[name]} and {size}).")
            given = None if mask is None else _read_picture(mask)
            usable |= _write_picture(folder, name, file_name(number, moment), image, given, bool(masks))
            done = number * moments + moment + 1
            progress(round(5 * done / (len(names) * moments)), 100)
        if not usable:
            raise StudioError(f"Camera '{name}': the mask leaves nothing of the image to find features in; mend it.")
    return sizes, moments


def _write_picture(
    folder: Path, name: str, file: str, image: np.ndarray, mask: np.ndarray | None, masked: bool
) -> bool:
    """One picture and its mask; whether the mask leaves anything."""
    import cv2

    if mask is None:
        mask = np.full(image.shape[:2], 255, np.uint8)
    if mask.shape != image.shape[:2]:
        raise StudioError(
            f"Camera '{name}': the mask is {mask.shape[1]}x{mask.shape[0]}, the image "
            f"{image.shape[1]}x{image.shape[0]}; give masks of the image's size."
        )
    usable = mask >= (1 if mask.max() <= 1 else 128)
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    files = {folder / "images" / file: image[:, :, ::-1]}
    if masked:
        files[folder / "masks" / f"{file}.png"] = usable.astype(np.uint8) * 255
    for path, pixels in files.items():
        if not cv2.imwrite(str(path), np.ascontiguousarray(pixels), fast):
            raise StudioError(f"{path}: cannot be written; check the disk and the permissions.")
    return bool(usable.any())


def _job(
    names: Sequence[str],
    sizes: Mapping[str, tuple[int, int]],
    moments: int,
    masks: bool,
    known: Mapping[str, Camera],
    focal_lengths: Mapping[str, float],
    settings: SfmSettings,
    poses: Rig | None,
) -> dict[str, Any]:
    lenses: list[dict[str, Any]] = []
    lens_of: list[int] = []
    shared: dict[tuple[int, int, int], int] = {}
    groups = {name: index for index, group in enumerate(settings.lens_groups) for name in group}
    strange = [name for name in groups if name not in names]
    if strange:
        raise StudioError(f"lens_groups names camera '{strange[0]}', of which there is no image.")
    for name in names:
        width, height = sizes[name]
        key = (groups.get(name, -1), width, height)
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
            if (settings.shared_lens or name in groups) and key in shared:
                lens_of.append(shared[key])
                continue
            shared[key] = len(lenses)
            focal = focal_lengths.get(name, settings.focal_factor * max(width, height))
            # terms that few matches leave open place cameras wrongly while they are put together
            model = _SIMPLER.get(settings.lens, settings.lens)
            parameters = _START[model](float(focal), width / 2, height / 2)
            lens = {"model": model, "params": parameters, "prior": name in focal_lengths, "known": False}
            lens["becomes"] = settings.lens
        lens_of.append(len(lenses))
        lenses.append({**lens, "width": width, "height": height})
    return {
        "names": list(names),
        "moments": moments,
        "lenses": lenses,
        "lens_of": lens_of,
        "masks": masks,
        "pairs": neighbours(poses) if poses is not None else [],
        "poses": [camera.world_to_camera[:3].tolist() for camera in poses] if poses is not None else [],
        "keep_poses": settings.keep_poses,
        "max_features": settings.max_features,
        "max_image_size": settings.max_image_size,
        "guided": settings.guided,
        "mapper": settings.mapper,
        "seed": settings.seed,
        "threads": settings.threads or os.cpu_count() or 1,
        "keep_known": settings.keep_known,
        "refine_principal_point": settings.refine_principal_point,
        "find_shared": settings.shared_lens is None and not settings.lens_groups,
    }


def neighbours(rig: Rig, each: int = 10, widest: float = 80.0) -> list[tuple[int, int]]:
    """Pairs of cameras worth matching where their poses are known.

    Args:
        rig: the cameras.
        each: a camera is paired with this many of the nearest.
        widest: degrees between viewing directions beyond which features do not match.

    Returns:
        pairs of indices, the smaller first, sorted.
    """
    centers = rig.centers
    forward = np.array([camera.forward for camera in rig])
    angles = np.degrees(np.arccos(np.clip(forward @ forward.T, -1, 1)))
    pairs = set()
    for index in range(len(rig)):
        order = np.argsort(np.linalg.norm(centers - centers[index], axis=1), kind="stable")
        near = [int(other) for other in order if other != index and angles[index, other] <= widest]
        pairs |= {(min(index, other), max(index, other)) for other in near[:each]}
    return sorted(pairs)


def _moved(result: CalibrationResult, before: Rig, settings: SfmSettings) -> dict[str, dict[str, float]]:
    """How far each camera is from where it stood in the older solution: centre (in its units) and degrees."""
    if settings.keep_poses or len(result.rig) < 3:
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
    report["explained"] = solution["explained"]
    report["sharing"] = [
        {**each, "images": [names[number] for number in each["images"]]} for each in solution["sharing"]
    ]
    return CalibrationResult(rig, points, colors, report)


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
