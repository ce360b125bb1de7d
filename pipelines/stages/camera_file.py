"""The capture's calibration file: the one in the settings, or the one found under a usual name."""

from __future__ import annotations

from pathlib import Path

from studio.capture.settings import FileSettings
from studio.errors import StudioError

_FOLDERS = (
    ".", "calibration", "cameras", "sparse/0", "sparse", "colmap/sparse/0", "sparse_full_resolution", "image_white",
)  # fmt: skip


def camera_file(settings: FileSettings) -> Path | None:
    """The calibration of a capture.

    Returns:
        file or folder; None if the cameras must be calibrated from footage.

    Raises:
        StudioError: the file in `capture.rig` does not exist (`settings.file_not_found`), or there are several under
            usual names (`camera_file.several`).
    """
    if settings.rig is None:
        return None
    if settings.rig != "auto":
        path = settings.root / settings.rig
        if not path.exists():
            raise StudioError(
                "settings.file_not_found",
                "no such file",
                file=path,
                value=settings.rig,
                fix="Set capture.rig to the calibration file, or to null to calibrate from the footage.",
                setting="capture.rig",
            )
        return path
    from studio.camera_files import find_camera_files

    found: list[Path] = []
    for folder in (settings.root / name for name in _FOLDERS):
        found += find_camera_files(folder) if folder.is_dir() else []
    if not found:  # VideoGS: a folder per frame with its own transforms.json, the same in all
        frames = [part for part in settings.root.glob("*/transforms.json") if part.parent.name.isdecimal()]
        found = sorted(frames, key=lambda part: int(part.parent.name))[:1]
    if len(found) > 1:
        names = [str(path.relative_to(settings.root)) for path in found]
        raise StudioError(
            "camera_file.several",
            f"several calibrations found ({', '.join(names)})",
            file=settings.root,
            fix="Set capture.rig to one of them.",
            setting="capture.rig",
            found=names,
        )
    return found[0] if found else None
