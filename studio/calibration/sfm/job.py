"""What structure from motion is asked for: the settings, and the job that the worker's process reads."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from studio.calibration.settings import CalibrateSettings
from studio.camera_files.colmap_model import lens_model
from studio.cameras import Camera, Rig
from studio.errors import StudioError

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
) -> dict[str, Any]:
    """The job for `sfm.worker`, JSON-ready.

    Args:
        names: the cameras.
        sizes: (width, height) of each camera's images.
        sync_frames: pictures a camera.
        masks: whether there are masks.
        known: cameras whose lenses are known.
        focal_lengths: first guesses in pixels, by camera.
        settings: how to solve.
        poses: an older solution of all the cameras, or None.
        threads: CPU threads; 0: all cores.
        seed: of all random choices.

    Raises:
        StudioError: intrinsics_groups names a camera that is not there, or a known lens is of another image size.
    """
    lenses: list[dict[str, Any]] = []
    lens_of: list[int] = []
    shared: dict[tuple[int, int, int], int] = {}
    groups = {name: index for index, group in enumerate(settings.intrinsics_groups) for name in group}
    strange = [name for name in groups if name not in names]
    if strange:
        raise StudioError(f"intrinsics_groups names camera '{strange[0]}', of which there is no image.")
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
            if (settings.shared_intrinsics or name in groups) and key in shared:
                lens_of.append(shared[key])
                continue
            shared[key] = len(lenses)
            focal = focal_lengths.get(name, settings.focal_factor * max(width, height))
            # terms that few matches leave open place cameras wrongly while they are put together
            model = _SIMPLER.get(settings.camera_model, settings.camera_model)
            parameters = _START[model](float(focal), width / 2, height / 2)
            lens = {"model": model, "params": parameters, "prior": name in focal_lengths, "known": False}
            lens["becomes"] = settings.camera_model
        lens_of.append(len(lenses))
        lenses.append({**lens, "width": width, "height": height})
    return {
        "names": list(names),
        "sync_frames": sync_frames,
        "lenses": lenses,
        "lens_of": lens_of,
        "masks": masks,
        "pairs": neighbors(poses) if poses is not None else [],
        "poses": [camera.world_to_camera[:3].tolist() for camera in poses] if poses is not None else [],
        "fix_poses": settings.fix_poses,
        "max_features": settings.max_features,
        "max_image_size": settings.max_image_size,
        "guided": settings.guided,
        "mapper": settings.mapper,
        "seed": seed,
        "threads": threads or os.cpu_count() or 1,
        "fix_intrinsics": settings.fix_intrinsics,
        "refine_principal_point": settings.refine_principal_point,
        "find_shared": settings.shared_intrinsics is None and not settings.intrinsics_groups,
    }


def neighbors(rig: Rig, each: int = 10, widest: float = 80.0) -> list[tuple[int, int]]:
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
