"""Camera solutions in files: one `read_rig` for all known forms, one `write_rig`."""

from __future__ import annotations

from pathlib import Path

from studio.camera_files.colmap_model import read_colmap, write_colmap
from studio.camera_files.common import read_json, read_text
from studio.camera_files.qualisys import read_qualisys
from studio.camera_files.rig_json import rig_from_values, write_rig_json
from studio.camera_files.transforms_json import rig_from_transforms, write_transforms
from studio.cameras import Rig
from studio.errors import StudioError

__all__ = ["read_rig", "write_rig"]

_KNOWN = "rig.json, cameras.json (K, R, t), transforms.json, a COLMAP model folder, or a Qualisys .qca.txt"
_COLMAP_FILES = {f"{stem}.{suffix}" for stem in ("cameras", "images", "points3D") for suffix in ("bin", "txt")}


def read_rig(path: Path | str) -> Rig:
    """Read cameras; the form is told by the content.

    Args:
        path: rig.json, a cameras.json with K, R, t, a transforms.json (instant-ngp, nerfstudio, NeuS2, VideoGS), a
            COLMAP model folder (text or binary, or any file in it), or a Qualisys .qca.txt.

    Returns:
        the rig, in our conventions (OpenCV axes, pixel origin at the image corner).

    Raises:
        StudioError: nothing there, an unknown form, a missing key, a value that is not finite, two cameras of one
            name, a file cut short: names the file and the value.
    """
    path = Path(path)
    if path.is_dir():
        return read_colmap(path)
    if not path.exists():
        raise StudioError(f"{path}: there is no such camera file.")
    if path.name in _COLMAP_FILES:
        return read_colmap(path.parent)
    start = read_text(path).lstrip()[:1]
    if start == "<":
        return read_qualisys(path)
    if start not in "{[":
        raise StudioError(f"{path}: this is no camera file that V3 Studio knows; give {_KNOWN}.")
    values = read_json(path)
    if isinstance(values.get("cameras"), list):  # cameras.json may say how many "frames" the capture has
        return rig_from_values(path, values)
    if "frames" in values:
        return rig_from_transforms(path, values)
    raise StudioError(f"{path}: has neither 'cameras' nor 'frames'; give {_KNOWN}.")


def write_rig(rig: Rig, path: Path | str) -> None:
    """Write cameras, atomically.

    Args:
        rig: what to write.
        path: `transforms*.json` becomes a transforms.json, any other `.json` our rig.json, a path without an
            extension a COLMAP text model folder.

    Raises:
        StudioError: an unknown extension, a camera that the form cannot say, an unwritable place.
    """
    path = Path(path)
    if path.suffix == ".json":
        if path.name.lstrip(".").startswith("transforms"):
            write_transforms(rig, path)
        else:
            write_rig_json(rig, path)
    elif path.suffix == "" or path.is_dir():
        write_colmap(rig, path)
    else:
        raise StudioError(f"{path}: cameras are written as .json or as a COLMAP folder, not as '{path.suffix}'.")
