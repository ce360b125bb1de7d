"""Look into a folder of footage before there is a take, for `v3studio init` and the window's dialog."""

import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from v3studio.pipelines.stages.camera_file import camera_file, camera_file_text, rig_of_capture
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.detect import MASK_FOLDERS, PLATE_FOLDERS, all_beside
from v3studio.studio.capture.patterns import walk
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.footage import Footage, find_cameras, open_footage, suggested_held_out
from v3studio.studio.masks.mask_files import FileMaskSource
from v3studio.studio.masks.mask_source import masked_cameras
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.storage import is_address

STRIP = 10  # most frames of the strip of frames
SOUNDS = frozenset({".aac", ".flac", ".m4a", ".mp3", ".ogg", ".opus", ".wav"})  # extensions of sound files
THUMBNAIL = 96  # height of a thumbnail, pixels
BACKGROUND = 0.35  # brightness of what is not in the mask, where there are mask files


@dataclass(frozen=True, eq=False)
class Inspection:
    """The files in a folder of footage, and what can be chosen among them."""

    lines: tuple[str, ...] = ()  # what was found, one sentence each
    choices: tuple[str, ...] = ()  # those of `lines` about what settings choose, see `Footage`
    problems: tuple[Message, ...] = ()
    rigs: tuple[str, ...] = ()  # calibration files to choose from with `capture.rig`; empty if there is one, or none
    # masks, plates, sounds: what there is to choose from for `capture.mask_files`, `capture.clean_plates` and
    # `capture.audio`
    masks: tuple[str, ...] = ()
    plates: tuple[str, ...] = ()
    sounds: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()  # names of all cameras, also of those that are not used
    used: tuple[str, ...] = ()  # those that a take would use
    unmasked: tuple[str, ...] = ()  # those without mask files, although others have them
    suggested: tuple[str, ...] = ()  # cameras to hold out for evaluation, unless some are
    frames: tuple[int, ...] = ()  # numbers of the frames that all cameras have
    filmed_fps: float | None = None  # frames per second that the files give; None if they give none
    # (H, W, 3) uint8 RGB of the first frame by camera, darker outside of the mask; empty for footage in object storage,
    # which would have to be copied
    thumbnails: dict[str, np.ndarray] = field(default_factory=dict)
    strip: dict[int, np.ndarray] = field(default_factory=dict)  # the same of some frames of one camera, by their number


def inspect(capture: CaptureSettings, progress: ProgressFn | None = None) -> Inspection:
    with closing(open_footage(capture, None, strict=False)) as footage:
        rigs: Sequence[str] = ()
        try:
            camera_file(footage.spec)
        except StudioError as error:
            rigs = error.message.fields.get("found", ())
        cameras = find_cameras(capture)
        masked = masked_cameras(footage.mask_source, cameras)
        shown = progress is not None and not is_address(capture.root)
        thumbnails, strip = _images(footage, progress or no_progress) if shown else ({}, {})
        return Inspection(
            lines=found_lines(footage),
            choices=footage.choices,
            problems=(*footage.problems, *footage.warnings),
            rigs=tuple(rigs),
            masks=_beside(footage, MASK_FOLDERS),
            plates=_beside(footage, PLATE_FOLDERS),
            sounds=tuple(path for path in walk(footage.spec.root, 1) if Path(path).suffix.lower() in SOUNDS),
            cameras=cameras,
            used=footage.camera_names,
            unmasked=tuple(name for name in cameras if name not in masked),
            suggested=() if footage.held_out_cameras else suggested_held_out(footage.camera_names),
            frames=footage.frames,
            filmed_fps=footage.filmed_fps,
            thumbnails=thumbnails,
            strip=strip,
        )


def found_lines(footage: Footage) -> tuple[str, ...]:
    """Sentences about footage and its camera file, one each. Cameras to hold out are suggested once."""
    lines, cameras = footage.description.splitlines(), camera_file_text(footage).splitlines()
    if any("capture.held_out: " in line for line in cameras):
        lines = [line for line in lines if "capture.held_out: " not in line]
    return (*lines, *cameras)


def with_camera_file(footage: Footage) -> Footage:
    """Footage that was opened without cameras, opened again with those of its camera file, and with each camera's own
    masks, to check it; itself if there is no such file. Raises StudioError: the file cannot be read or does not fit."""
    path = camera_file(footage.spec)
    if path is None:
        return footage
    rig = rig_of_capture(path, footage)
    return open_footage(footage.spec, rig, strict=False, without_masks=footage.without_masks, votes=False)


def _beside(footage: Footage, folders: re.Pattern[str]) -> tuple[str, ...]:
    """Patterns of masks or clean plates, one for each set of files."""
    files_by_pattern: dict[str, set[Path]] = {}
    for pattern, matches in all_beside(footage.spec.root, folders, footage.camera_names):
        files = {match.path for match in matches}
        if not any(files & other for other in files_by_pattern.values()):
            files_by_pattern[pattern] = files
    return tuple(files_by_pattern)


def _images(footage: Footage, progress: ProgressFn) -> tuple[dict[str, np.ndarray], dict[int, np.ndarray]]:
    at = np.unique(np.linspace(0, len(footage.frames) - 1, min(STRIP, len(footage.frames))).round().astype(int))
    strip = [footage.frames[index] for index in at]
    wanted = [(name, footage.frames[0]) for name in footage.camera_names]
    middle = footage.camera_names[len(footage.camera_names) // 2]
    wanted += [(middle, frame) for frame in strip]
    images = []
    for number, (camera, frame) in enumerate(wanted):
        progress(number, len(wanted))
        images.append(_thumbnail(footage, camera, frame))
    count = len(footage.camera_names)
    by_camera = {name: image for (name, _), image in zip(wanted, images[:count], strict=False) if image is not None}
    return by_camera, {frame: image for frame, image in zip(strip, images[count:], strict=True) if image is not None}


def _thumbnail(footage: Footage, camera: str, frame: int) -> np.ndarray | None:
    """A small image; None for one that cannot be read, which the check of the footage reports."""
    import cv2

    try:
        image = footage.raw_image(camera, frame)
        if isinstance(footage.mask_source, FileMaskSource) and camera in footage.mask_source.cameras:
            mask = footage.raw_mask(camera, frame)
            image = np.where(mask[..., None] > 127, image, BACKGROUND * image).astype(np.uint8)
    except StudioError:
        return None
    width = max(round(THUMBNAIL * image.shape[1] / image.shape[0]), 1)
    return np.ascontiguousarray(cv2.resize(image, (width, THUMBNAIL), interpolation=cv2.INTER_AREA))
