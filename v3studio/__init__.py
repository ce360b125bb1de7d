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

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.3.0"

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_MODULES = {one.name: str(node.module) for node in _STUB.body if isinstance(node, ast.ImportFrom) for one in node.names}
"""By name, from the stub that type checkers read."""

__all__ = sorted(["__version__", *_MODULES])


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'v3studio' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__.copy()
