"""Garbage masks: parts of the image that can never contain the performer."""

import difflib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from v3studio.studio.capture.frame_sources import DecoderPool, make_sources
from v3studio.studio.capture.patterns import VIDEO_EXTENSIONS, Match
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.errors import StudioError
from v3studio.studio.masks.garbage_polygons import EXTENSIONS, GarbagePolygons, read_garbage_polygons
from v3studio.studio.masks.mask_files import FileMaskSource, matching
from v3studio.studio.masks.mask_source import GarbageMasks
from v3studio.studio.storage import whole_files


def _drawn(path: Path, polygons: Mapping[str, GarbagePolygons]) -> GarbageMasks:
    """Polygons of a file, by camera; without any, the whole image is kept."""

    def inside(camera: str, frame: int, image: np.ndarray) -> np.ndarray | None:
        return polygons[camera].inside(image.shape[1], image.shape[0]) if camera in polygons else None

    return GarbageMasks(inside, [path])


def _images(matches: list[Match], pool: DecoderPool, offsets: Mapping[str, int]) -> GarbageMasks:
    """One image per camera, which applies to all frames, or per camera and frame; black excludes. Cameras without a
    garbage mask keep the whole image. `offsets`, as in `CaptureSettings`, apply to files with a frame number and to
    videos. StudioError, also of `inside`: a file cannot be read, `mask.aspect_ratio`, or `footage.no_such_frame`."""
    cameras = {match.camera for match in matches}
    still = {
        match.camera for match in matches if match.frame is None and match.path.suffix.lower() not in VIDEO_EXTENSIONS
    }
    moving = {camera: offset for camera, offset in offsets.items() if camera not in still}
    source = FileMaskSource(make_sources(matches, pool, moving, "srgb", "auto"))

    def inside(camera: str, frame: int, image: np.ndarray) -> np.ndarray | None:
        return source.mask(camera, 0 if camera in still else frame, image) > 127 if camera in cameras else None

    return GarbageMasks(inside, source.files())


def garbage_masks(spec: CaptureSettings, names: tuple[str, ...], pool: DecoderPool) -> GarbageMasks | None:
    """The garbage masks of the cameras `names`; None without the setting. Raises StudioError: `mask.garbage_*`."""
    if not spec.garbage_masks:
        return None
    value, setting = spec.garbage_masks, "capture.garbage_masks"
    if Path(value).suffix.lower() in EXTENSIONS:
        path = whole_files([spec.root / Path(value).expanduser()])[0]
        polygons = read_garbage_polygons(path)
        unknown = [camera for camera in polygons if camera not in names]
        if unknown and not (spec.cameras and len(unknown) < len(polygons)):  # others may be left out on purpose
            near = difflib.get_close_matches(unknown[0], names, n=1, cutoff=0.5)
            problem = f"the footage has no camera '{unknown[0]}'"
            fix = (f"Did you mean '{near[0]}'? " if near else "") + f"Cameras: {', '.join(names)}."
            raise StudioError("mask.garbage_file", problem, file=path, value=unknown[0], fix=fix, setting=setting)
        return _drawn(path, polygons)
    problem = f"no garbage mask of the footage's cameras matches the pattern '{value}'"
    fix = "Check capture.garbage_masks."
    none = StudioError("mask.garbage_not_found", problem, file=spec.root, value=value, fix=fix, setting=setting)
    return _images(matching(spec.root, value, names, none), pool, spec.offsets)
