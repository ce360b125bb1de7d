"""poses_bounds.npy of LLFF, as in Neural 3D Video (N3DV).

One row of 17 numbers per camera: a 3 x 5 matrix, row by row, and the nearest and farthest depth. The matrix is camera
to world with the axes down, right, back, the center, and image height, width and focal length. There is no lens
distortion, and the principal point is the center of the image. The rows are in the order of the videos' names.
"""

from pathlib import Path

import numpy as np

from v3studio.studio.camera_files.common import rigid_inverse
from v3studio.studio.camera_files.common.camera_file import CameraFile
from v3studio.studio.camera_files.common.keyed import NO_DISTORTION
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.capture.patterns import IMAGE_EXTENSIONS, VIDEO_EXTENSIONS
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import is_out_of_memory
from v3studio.studio.validation import check_finite

_FOLDERS = ("", "videos", "images", "frames")


def read(file: CameraFile) -> Rig:
    """Read the cameras, which are named after the videos, images or folders next to the file."""
    try:
        rows = np.load(file.path, allow_pickle=False)
    except Exception as error:  # NumPy raises even tokenize.TokenError for a damaged head
        if is_out_of_memory(error):
            raise
        raise _invalid(f"not a NumPy array ({error})") from None
    if rows.ndim != 2 or rows.shape[1] != 17 or rows.dtype.kind not in "fiu" or not len(rows):
        problem = (
            f"the array is {'x'.join(map(str, rows.shape))} of {rows.dtype}, not the 17 numbers per camera of LLFF"
        )
        raise _invalid(problem, "Copy it again if it is LLFF's poses_bounds.npy, else export the cameras as text.")
    names = _names(file.path.parent, len(rows))
    cameras = []
    for name, row in zip(names, rows.astype(np.float64), strict=True):
        check_finite(row, "row", name)
        matrix = row[:15].reshape(3, 5)
        down, right, back, center = matrix[:, :4].T
        pose = np.column_stack([right, down, -back, center])
        height, width, focal = matrix[:, 4]
        K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
        cameras.append(Camera(name, round(width), round(height), K, rigid_inverse(pose)))
    order = f"The rows of poses_bounds.npy are taken in the order of the names: {', '.join(names[:3])}, ..."
    middle = "It has no principal points: they are taken to be the image centers."
    return Rig(tuple(cameras), (NO_DISTORTION, middle, order))


def _names(folder: Path, count: int) -> list[str]:
    counts = []
    for part in _FOLDERS:
        if not (folder / part).is_dir():
            continue
        entries = sorted((folder / part).iterdir(), key=lambda entry: entry.name)
        groups = (
            [entry.stem for entry in entries if entry.suffix.lower() in VIDEO_EXTENSIONS],
            [entry.stem for entry in entries if entry.suffix.lower() in IMAGE_EXTENSIONS],
            [entry.name for entry in entries if entry.is_dir() and part],
        )
        for names in groups:
            if len(names) == count:
                return names
            if len(names) > 1:
                counts.append(len(names))
    problem = f"the file has {count} cameras, but the footage next to it has {counts[0] if counts else 'none'}"
    fix = (
        "The rows belong to the videos in the order of their names: put back missing videos, or set capture.rig "
        "to null to calibrate from the footage."
    )
    raise StudioError("camera_file.camera_count", problem, value=count, fix=fix, setting="capture.rig")


def _invalid(problem: str, fix: str = "Copy the file again.") -> StudioError:
    return StudioError("camera_file.syntax", problem, fix=fix)
