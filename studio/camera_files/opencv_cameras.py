"""Calibrations of OpenCV, XML or YAML with one file per camera, such as `{camera}/config.xml`.

Keys are those of `studio.camera_files.common.keyed`; pixel coordinates are OpenCV's: the center of the first pixel is
(0, 0).
"""

from pathlib import Path

from v3studio.studio.camera_files.common import no_cameras
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import KeyedForm, keyed_rig
from v3studio.studio.camera_files.common.nearby import size_nearby, size_within
from v3studio.studio.camera_files.common.opencv_storage import read_storage
from v3studio.studio.cameras import Rig
from v3studio.studio.capture.patterns import Match, find_files
from v3studio.studio.errors import StudioError

_EXTENSIONS = frozenset({".xml", ".yml", ".yaml"})


def files_of(path: Path) -> list[Match]:
    """The files that match a pattern with `{camera}`; empty for other paths."""
    if "{camera}" not in str(path):
        return []
    fixed = _fixed_part(path)
    return find_files(fixed, path.relative_to(fixed).as_posix(), _EXTENSIONS)


def _fixed_part(path: Path) -> Path:
    return next(parent for parent in path.parents if "{camera}" not in str(parent))


def matches(file: CameraFile) -> bool:
    """Return whether a file is the calibration of one camera, which `read` refuses."""
    return file.kind == "yaml" or (file.xml is not None and file.xml.tag == "opencv_storage")


def read(file: CameraFile) -> Rig:
    """Read the cameras of a pattern with `{camera}`. Raises StudioError: the path is that of one camera
    (camera_file.one_camera)."""
    if "{camera}" not in str(file.path):
        problem = "an OpenCV calibration, which describes one camera"
        fix = "Set capture.rig to the pattern of all of them, for example '{camera}/config.xml'."
        raise StudioError("camera_file.one_camera", problem, fix=fix, setting="capture.rig")
    root, files = _fixed_part(file.path), files_of(file.path)
    if not files:
        raise no_cameras(f"no file matches '{file.path.relative_to(root).as_posix()}'", root)
    folders = {match.camera: match.path.parent for match in files}
    form = KeyedForm(size_of=lambda name: size_within(folders[name], name) or size_nearby(root, name, name))
    return keyed_rig(root, [(match.camera, read_storage(match.path)) for match in files], form)
