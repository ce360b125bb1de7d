"""What the calibrate stage is told of the cameras beforehand: older solutions, distances, EXIF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.stages.base import Context
from studio.calibration.settings import CalibrateSettings
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.cameras import Camera, Rig
    from studio.capture import Footage


def known_file(context: Context) -> Path:
    """calibrate.known_cameras.

    Raises:
        StudioError: it is not there.
    """
    return _named(context, "known_cameras", "camera file")


def tie_file(context: Context) -> Path:
    """calibrate.tie_points.

    Raises:
        StudioError: it is not there.
    """
    return _named(context, "tie_points", "file of tie points")


def _named(context: Context, setting: str, what: str) -> Path:
    path: Path = context.config.capture.root / getattr(context.config.calibrate, setting)
    if not path.exists():
        raise StudioError(
            f"{path}: there is no such {what}; mend calibrate.{setting} (relative names begin at capture.root)."
        )
    return path


def known_cameras(context: Context) -> Rig | None:
    """The cameras of calibrate.known_cameras, at the footage's size and under its names; None where it is empty.

    Raises:
        StudioError: the file is unusable or lacks a camera, or known_poses without a file.
    """
    from studio.camera_files import read_rig
    from studio.cameras import Rig
    from studio.capture import match_rig

    section = context.config.calibrate
    if not section.known_cameras:
        if section.known_poses:
            raise StudioError("calibrate.known_poses needs the older solution; name it in calibrate.known_cameras.")
        return None
    footage = context.footage.raw
    found = match_rig(read_rig(known_file(context)), footage.camera_names)
    return Rig(tuple(at_footage_size(context, name, camera) for name, camera in found.items()))


def at_footage_size(context: Context, name: str, camera: Camera) -> Camera:
    """A camera that was calibrated at another size, as the footage shows it (`capture.size_rule`).

    Raises:
        StudioError: the aspect ratios differ and the rule does not say what to do.
    """
    from studio.capture.warp import Warp, fit_size

    footage = context.footage.raw
    width, height = footage.raw_size(name)
    rule = context.config.capture.size_rule
    same_shape = width * camera.height == height * camera.width
    image = footage.raw_image(name, footage.frames[0]) if rule == "auto" and not same_shape else None
    return Warp(camera, width, height, 1.0, fit_size(camera, width, height, rule, image)).source


def check_sizes(context: Context, rig: Rig, path: Path) -> None:
    """See to it that the footage can be shown by cameras of another image size, before later stages find out.

    Cameras of the footage's aspect ratio always can: the footage scales them. They keep the size of their file here.

    Args:
        rig: the cameras, under the footage's names.
        path: the file that they are from.

    Raises:
        StudioError: the aspect ratios differ and `capture.size_rule` does not say what to do; names the file.
    """
    from studio.camera_files.common import naming

    with naming(path):
        for camera in rig:
            at_footage_size(context, camera.name, camera)


def known_distance(section: CalibrateSettings, names: Sequence[str]) -> tuple[str, str, float] | None:
    """calibrate.scale_between and scale_distance; `names` are the cameras that there are.

    Raises:
        StudioError: one without the other, or not two cameras of the footage.
    """
    if not section.scale_between and section.scale_distance is None:
        return None
    if len(section.scale_between) != 2 or section.scale_distance is None:
        raise StudioError(
            "A known scale needs two cameras in calibrate.scale_between and their distance in meters in "
            f"calibrate.scale_distance; given are {list(section.scale_between)} and {section.scale_distance}."
        )
    for name in section.scale_between:
        if name not in names:
            raise StudioError(
                f"calibrate.scale_between names camera '{name}', which the footage has not; it has {', '.join(names)}."
            )
    return section.scale_between[0], section.scale_between[1], section.scale_distance


def focal_lengths(footage: Footage, frame: int) -> dict[str, float]:
    """Camera name to focal length in pixels, where the photographs' EXIF data say one (as COLMAP reads them)."""
    import pycolmap

    found = {}
    for name in footage.camera_names:
        file = footage.file_of(name, frame)
        if file is None or file.suffix.lower() not in (".jpg", ".jpeg", ".tif", ".tiff"):
            continue
        camera = pycolmap.infer_camera_from_image(file)
        if camera.has_prior_focal_length:
            found[name] = float(camera.mean_focal_length())
    return found
