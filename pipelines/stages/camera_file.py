"""The capture's calibration file: the one in the settings, or the one found under a usual name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from v3studio.studio.camera_files import CAMERA_FORMATS, find_camera_files, read_rig
from v3studio.studio.camera_files.opencv_cameras import files_of
from v3studio.studio.capture.detect import detect_images, named_in
from v3studio.studio.capture.patterns import IMAGE_EXTENSIONS
from v3studio.studio.capture.settings import FileSettings
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from v3studio.studio.cameras import Rig
    from v3studio.studio.footage import Footage

_FOLDERS = (
    ".", "calibration", "cameras", "cams", "sparse", "colmap/sparse", "sparse_full_resolution",
    "image_white",
)  # fmt: skip


def camera_file(settings: FileSettings) -> Path | None:
    """File, folder or pattern with `{camera}` of a capture's calibration; None: calibrate from the footage."""
    if settings.rig is None:
        return None
    if settings.rig != "auto":
        path = settings.root / settings.rig
        if not path.exists() and not files_of(path):
            fix = "Set capture.rig to the calibration file, or to null to calibrate from the footage."
            raise StudioError(
                "settings.file_not_found", "no such file", file=path, value=settings.rig, fix=fix, setting="capture.rig"
            )
        return path
    files = _in(settings.root)
    if not files:
        below = _folder_of_footage(settings)
        files = _in(below) if below is not None else []
    if not files and _is_named_above(settings.root):
        files = [settings.root.parent / "transforms.json"]
    if len(files) > 1:
        names = [str(path.relative_to(settings.root)) for path in files]
        problem = f"several calibrations found ({', '.join(names)})"
        fix = "Set capture.rig to one of them."
        raise StudioError(
            "camera_file.several", problem, file=settings.root, fix=fix, setting="capture.rig", found=names
        )
    return files[0] if files else None


def rig_of_capture(path: Path, footage: Footage) -> Rig:
    """The cameras of a camera file that opened footage has, under their names there; see `rig_of_footage`."""
    from v3studio.studio.footage import rig_of_footage

    sizes = {name: footage.raw_size(name) for name in footage.camera_names}
    known = (*footage.camera_names, *footage.not_chosen)
    return rig_of_footage(read_rig(path, sizes), footage.spec, footage.camera_names, footage.without_masks, known)


def camera_file_text(footage: Footage) -> str:
    """Say what is known about the calibration of opened footage, one sentence per line; or why it cannot be used."""
    try:
        path = camera_file(footage.spec)  # of a capture in object storage, this has the folder on this machine
    except StudioError as error:
        return str(error)
    if path is None:
        return "No camera file: Calibrate estimates the cameras."
    name = os.path.relpath(path, footage.spec.root)  # it may be beside the footage's folder
    try:
        rig = rig_of_capture(path, footage)
    except StudioError as error:
        return f"Camera file: {name}.\n{error}"
    return "\n".join([f"Camera file: {name}.", *rig.notes])


def _folder_of_footage(settings: FileSettings) -> Path | None:
    """The folder of `root` that has all the footage, if there is one."""
    try:
        pattern = detect_images(settings.root)[0] if settings.images == "auto" else settings.images
    except StudioError:  # reported when the footage is opened
        return None
    folder, slash, _ = pattern.partition("/")
    below = settings.root / folder
    return below if slash and "{" not in folder and below.is_dir() else None


def _in(root: Path) -> list[Path]:
    """The calibrations of a capture's folder."""
    folders = [root / name for name in _FOLDERS]
    files = [path for folder in folders if folder.is_dir() for path in find_camera_files(folder)]
    exact = [path for path in files if path in folders or path.parent in folders]  # not those of VideoGS's frames
    patterns = [root / pattern for form in CAMERA_FORMATS for pattern in form.per_camera]
    return exact or files[:1] or [pattern for pattern in patterns if _is_of_cameras(pattern)][:1]


def _is_of_cameras(pattern: Path) -> bool:
    """Return whether several files match, and not the settings of takes in the folder of their footage."""
    return len([match for match in files_of(pattern) if not (match.path.parent / "take.json").is_file()]) > 1


def _is_named_above(root: Path) -> bool:
    """Return whether a transforms.json next to the folder names the images in it, as for HiFi4G's example/."""
    names = named_in(root.parent / "transforms.json")
    return len(names) > 1 and names <= {file.stem for file in root.iterdir() if file.suffix.lower() in IMAGE_EXTENSIONS}
