"""V3 Studio for scripts: from synchronized multi-camera footage to a streamable Gaussian video, and back.

Everything exported here is stable: incompatible changes follow the version number and are listed in CHANGELOG.md.
Modules below `studio`, `pipelines` and `gui` may change in any release; import from this package instead. `examples/`
contains scripts that use each part.

    footage        open_footage, CaptureSettings, Footage, FunctionMaskSource
    cameras        read_rig, write_rig, Rig, Camera, Camera.look_at, orbit
    calibration    calibrate_from_images, detect_target, calibrate_from_target, calibrate_from_tie_points, ...
    takes          Take, load_config, run, status, trained_video: the stages of the command line, on a take's folder
    training       initialize_points, TrainingView, train_keyframe, train_interframe
    splats         Gaussians, read_splats, write_splats, rasterize
    streams        bake_video, bake_group, write_manifest, BakeSettings, StreamReader, SplatVideo, open_import,
                   check_stream
    sharing        share, serve, publish, PageText
    measuring      evaluate, psnr, ssim

Conventions: quaternions are wxyz; camera axes are OpenCV's (x right, y down, z forward), and `world_to_camera` is 4x4;
the pixel origin is the outer corner of the top-left pixel; images are RGB.

Exports are imported on first use, so `import v3studio` is fast.
"""

from importlib import import_module
from typing import Any

__version__ = "0.3.0"

_EXPORTS = {
    "pipelines.config": ("Config", "load_config"),
    "pipelines.events": ("Event", "Metrics", "Progress", "Finished", "StageFinished", "Warned"),
    "pipelines.runs.runner": ("run", "status"),
    "pipelines.runs.staleness": ("StageStatus",),
    "pipelines.share.page": ("PageText",),
    "pipelines.share.serving": ("Serving", "serve"),
    "pipelines.share.sharing": ("Shared", "publish", "share"),
    "pipelines.takes.take": ("Take",),
    "pipelines.takes.videos": ("trained_video",),
    "studio.calibration": (
        "CalibrationResult",
        "CalibrationTarget",
        "TiePoint",
        "align_rigs",
        "calibrate_from_images",
        "calibrate_from_target",
        "calibrate_from_tie_points",
        "compare_rigs",
        "detect_target",
        "read_tie_points",
        "write_target_pdf",
    ),
    "studio.calibration.settings": ("CalibrateSettings",),
    "studio.camera_files": ("read_rig", "write_rig"),
    "studio.cameras": ("Camera", "Rig", "orbit"),
    "studio.comparison": ("evaluate",),
    "studio.capture": ("CaptureSettings", "Footage", "FootageView", "open_footage"),
    "studio.errors": ("Cancelled", "Message", "StudioError"),
    "studio.formats": ("read_splats", "write_splats"),
    "studio.formats.baking": ("bake_video",),
    "studio.formats.sequence": ("open_import",),
    "studio.gaussians": ("Gaussians",),
    "studio.masks": ("FunctionMaskSource", "MaskFunction", "MaskSource"),
    "studio.meshing": ("InitResult", "Mesh", "initialize_points"),
    "studio.meshing.settings": ("InitializeSettings",),
    "studio.metrics": ("psnr", "ssim"),
    "studio.rasterizer": ("Render", "available_backends", "rasterize"),
    "studio.splat_video": ("SplatVideo",),
    "studio.stream": ("BakeSettings", "Manifest", "StreamReader", "bake_group", "write_manifest"),
    "studio.stream.integrity": ("check_stream",),
    "studio.stream.publish": ("Published",),
    "studio.training": ("TrainingView", "TrainSettings", "train_interframe", "train_keyframe"),
}
"""Names by module; type checkers read the same from __init__.pyi."""

_MODULES = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = sorted(["__version__", *_MODULES])


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'v3studio' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__.copy()
