"""The use of each camera: training, evaluation (held out), or none."""

from collections.abc import Mapping

from v3studio.studio.capture import CaptureSettings
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import find_cameras, held_out_cameras

USES = ("training", "held out", "not used")  # what a camera can be used for


def camera_uses(spec: CaptureSettings) -> dict[str, str]:
    """One of `USES` by camera, in the footage's order, as the settings say. Raises StudioError: there is no footage, or
    the settings name unknown cameras."""
    names = find_cameras(spec)
    used = tuple(name for name in names if not spec.cameras or name in spec.cameras)
    held_out = held_out_cameras(spec, used)
    return {name: "held out" if name in held_out else "training" if name in used else "not used" for name in names}


def settings_of_uses(uses: Mapping[str, str], spec: CaptureSettings) -> dict[str, object]:
    """Settings, by dotted name, that give the cameras these uses; offsets of unused ones, which are refused, go."""
    used = [name for name, use in uses.items() if use != "not used"]
    if "training" not in uses.values():
        problem = "no camera is left to train on"
        raise StudioError("settings.no_training_camera", problem, fix="Use at least one for it.")
    settings: dict[str, object] = {
        "capture.cameras": [] if len(used) == len(uses) else used,
        "capture.held_out": [name for name, use in uses.items() if use == "held out"],
    }
    if any(name not in used for name in spec.offsets):
        settings["capture.offsets"] = {name: offset for name, offset in spec.offsets.items() if name in used}
    return settings
