"""Jobs of structure from motion, and the cameras of COLMAP's models."""

from typing import Any

from v3studio.studio.calibration.sfm.job import SfmCamera, SfmJob
from v3studio.studio.camera_files.colmap_model import intrinsics
from v3studio.studio.cameras import Camera, Rig


def job_of(
    count: int, *, becomes: str = "", focal: float = 1280.0, size: tuple[int, int] = (1024, 768), **settings: Any
) -> SfmJob:
    """A job for cameras "0", "1", ... with intrinsics of their own."""
    width, height = size
    params = (focal, width / 2, height / 2, 0.0)
    own = SfmCamera(model="SIMPLE_RADIAL", width=width, height=height, params=params, becomes=becomes)
    of = list(range(count))
    values = {"names": [str(number) for number in of], "intrinsics": [own] * count, "intrinsics_of": of}
    return SfmJob(**values, **settings)


def rig_of(model: Any) -> Rig:
    """The cameras of a COLMAP model; that of image 1 is called "0"."""
    cameras = []
    for key in sorted(model.images):
        image = model.images[key]
        own = model.cameras[image.camera_id]
        lens, pose = intrinsics(own.model.name, list(own.params)), image.cam_from_world().matrix()
        cameras.append(Camera(str(key - 1), own.width, own.height, world_to_camera=pose, **lens))
    return Rig(tuple(cameras))
