"""NAME_cam.txt of MVSNet, one file per camera, as in PKU-DyMVHumans.

The word `extrinsic`, a 4 x 4 matrix (world to camera, OpenCV axes), the word `intrinsic`, a 3 x 3 matrix, and a range
of depths, which is not used. The principal point is relative to the image corner. The images are undistorted.
"""

import re
from contextlib import suppress
from pathlib import Path

from v3studio.studio.camera_files.common import read_text
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import NO_DISTORTION
from v3studio.studio.camera_files.common.nearby import size_nearby
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError, naming
from v3studio.studio.validation import array, check_finite

_SUFFIX = "_cam.txt"


def is_in(folder: Path) -> bool:
    """Return whether a folder has such files."""
    return any(folder.glob(f"*{_SUFFIX}"))


def matches(file: CameraFile) -> bool:
    """Return whether a path is a folder with such files."""
    return is_in(file.path)


def read(file: CameraFile) -> Rig:
    """Read all files of a folder; image sizes come from the footage around it."""
    return Rig(tuple(map(_camera, sorted(file.path.glob(f"*{_SUFFIX}")))), (NO_DISTORTION,))


def _camera(path: Path) -> Camera:
    name = path.name.removesuffix(_SUFFIX)
    text = read_text(path)
    with naming(path):
        matrices = []
        for word, count in (("extrinsic", 16), ("intrinsic", 9)):
            match = re.search(rf"(?<![a-z]){word}((?:\s+[-+.\deE]+){{{count}}})", text)
            if match is None:
                fix = "The file may be truncated: copy it again."
                raise StudioError("camera_file.truncated", f"no {count} numbers after '{word}'", fix=fix)
            value = array(match.group(1).split(), word, name)
            check_finite(value, word, name)
            matrices.append(value)
        root = path.parent.parent
        number = re.findall(r"\d+", name)
        stems = [f"cam_{int(number[-1])}", f"cam{int(number[-1])}", f"cam{int(number[-1]):02d}"] if number else []
        size = _size(root, [name, *stems], name)
        return Camera(name, *size, matrices[1].reshape(3, 3), matrices[0].reshape(4, 4))


def _size(root: Path, stems: list[str], name: str) -> tuple[int, int]:
    for stem in stems:
        for folder, inner in ((root, stem), (root / "per_view" / stem, "images")):
            with suppress(StudioError):
                return size_nearby(folder, inner, name)
    return size_nearby(root, name, name)  # the error is that of the first place
