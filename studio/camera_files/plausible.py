"""What is unlikely of the cameras of a file, whatever its format."""

from dataclasses import replace

from studio.cameras import Rig
from studio.counts import cameras_listed
from studio.validation import camera_error

_LEAST_FOCAL = 0.1  # of the longer side of the image: a field of view of 157 degrees


def checked(rig: Rig) -> Rig:
    """The rig, with notes on what is unlikely."""
    for camera in rig:
        focal, longer = min(camera.fx, camera.fy), max(camera.width, camera.height)
        if focal < _LEAST_FOCAL * longer:
            problem = f"a focal length of {focal:.4g} pixels is too short for images of {camera.width}x{camera.height}"
            fix = "Give focal lengths and principal points in pixels, not in millimeters or relative to the size."
            raise camera_error("camera.focal_length_unit", camera.name, problem, value=focal, fix=fix)
    outside = [one.name for one in rig if not (0 <= one.cx <= one.width and 0 <= one.cy <= one.height)]
    if not outside:
        return rig
    note = (
        "The principal point is outside of the image, as if the images had another size when they were calibrated: "
        f"{cameras_listed(outside)}."
    )
    return replace(rig, notes=(*rig.notes, note))
