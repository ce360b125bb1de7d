"""The intrinsics that calibration begins with."""

from collections.abc import Mapping, Sequence

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError

_SHORT, _BARREL = 0.7, -0.03


def may_be_fisheye(focal: float, distortion: Sequence[float] | np.ndarray) -> bool:
    """Tell whether a usual lens that was fitted to images may be a fisheye: a short focal length, as a multiple of the
    longer side, with barrel distortion. Others have less than 71 degrees across, or are straight."""
    return focal < _SHORT and len(distortion) > 0 and bool(distortion[0] < _BARREL)


def initial_camera(
    name: str, size: tuple[int, int], known: Mapping[str, Camera], focal_lengths: Mapping[str, float], guess: float
) -> Camera:
    """The known camera for images of (width, height) `size`; else one without distortion at the identity pose, with its
    focal length of `focal_lengths`, in pixels, or `guess` times the longer side. StudioError: the known intrinsics are
    for images of another size (calibration.intrinsics_size)."""
    width, height = size
    if name not in known:
        focal = focal_lengths.get(name, guess * max(size))
        return Camera(
            name, width, height, np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]), np.eye(4)
        )
    camera = known[name]
    if (camera.width, camera.height) != size:
        raise StudioError(
            "calibration.intrinsics_size",
            f"camera '{name}': the images are {width}x{height}, but its known intrinsics are for "
            f"{camera.width}x{camera.height}",
            value=[camera.width, camera.height],
            fix="Scale one of them.",
            camera=name,
            expected=list(size),
        )
    return camera
