"""Checks shared by all calibration methods."""

from studio.cameras import Camera
from studio.errors import StudioError


def check_intrinsics_size(camera: Camera, size: tuple[int, int]) -> None:
    """Check that a camera's known intrinsics are for images of the given size (width, height)."""
    if (camera.width, camera.height) != size:
        raise StudioError(
            "calibration.intrinsics_size",
            f"camera '{camera.name}': the images are {size[0]}x{size[1]}, but its known intrinsics are for "
            f"{camera.width}x{camera.height}",
            value=[camera.width, camera.height],
            fix="Scale one of them.",
            camera=camera.name,
            expected=list(size),
        )
