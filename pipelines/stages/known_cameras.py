"""Knowledge about the cameras before calibration: earlier results, EXIF focal lengths."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.camera_files import read_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.storage import whole_files

if TYPE_CHECKING:
    from v3studio.studio.footage import Footage


def named_file(section: CalibrateSettings, setting: Literal["known_cameras", "tie_points"], root: Path) -> Path:
    """The file that one of these settings names."""
    name = getattr(section, setting)
    path: Path = whole_files([root / name])[0]
    if not path.exists():
        fix = f"Fix calibrate.{setting}; relative paths start at capture.root."
        raise StudioError(
            "settings.file_not_found", "no such file", file=path, value=name, fix=fix, setting=f"calibrate.{setting}"
        )
    return path


def known_cameras(section: CalibrateSettings, footage: Footage) -> Rig | None:
    """The cameras of calibrate.known_cameras with the footage's image size and camera names; None if it is empty."""
    from v3studio.studio.footage import match_rig

    if not section.known_cameras:
        if section.known in ("poses", "initial_poses"):
            problem = f"calibrate.known: {section.known} needs calibrate.known_cameras"
            fix = "Set calibrate.known_cameras to the earlier calibration."
            raise StudioError("settings.missing", problem, fix=fix, setting="calibrate.known_cameras")
        return None
    known = read_rig(named_file(section, "known_cameras", footage.spec.root))
    matched = match_rig(replace(known, left_out=()), footage.camera_names)  # each camera must be known
    return Rig(tuple(at_footage_size(camera, footage) for camera in matched.values()))


def at_footage_size(camera: Camera, footage: Footage) -> Camera:
    """Convert a camera to the image size that it has in the footage (`capture.size_rule`)."""
    from v3studio.studio.footage.warp import Warp, fit_size

    width, height = footage.raw_size(camera.name)
    first = partial(footage.raw_image, camera.name, footage.frames[0])
    fit = fit_size(camera, width, height, footage.spec.size_rule, first)
    return Warp(camera, width, height, 1.0, fit).source


def check_sizes(rig: Rig, footage: Footage, path: Path) -> None:
    """Check that cameras of another image size can be used with the footage, before later stages fail.

    With the same aspect ratio they always can. The cameras themselves are not changed.
    """
    with naming(path):
        for camera in rig:
            at_footage_size(camera, footage)


def focal_lengths(footage: Footage, frame: int) -> dict[str, float]:
    """Focal lengths in pixels by camera name, where EXIF data have one; read by COLMAP."""
    import pycolmap

    lengths = {}
    for name in footage.camera_names:
        file = footage.file_of(name, frame)
        if file is None or file.suffix.lower() not in (".jpg", ".jpeg", ".tif", ".tiff"):
            continue
        camera = pycolmap.infer_camera_from_image(file)
        if camera.has_prior_focal_length:
            lengths[name] = float(camera.mean_focal_length())
    return lengths
