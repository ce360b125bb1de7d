"""V3 Studio for scripts: from synchronized multi-camera footage to a streamable Gaussian video, and back.

Everything exported here is stable: incompatible changes follow the version number and are listed in CHANGELOG.md.
Modules below `v3studio.studio`, `v3studio.pipelines` and `v3studio.gui` may change in any release. `examples/` contains
scripts that use each part.

    footage        open_footage, CaptureSettings, Footage, FunctionMaskSource
    cameras        read_rig, write_rig, Rig, Camera, Camera.look_at, orbit, Similarity, calibrate_from_images
    takes          Take, run, status, load_config, trained_video, Trim, read_evaluation
    training       initialize_points, TrainingView, train_keyframe, train_interframe
    splats         Gaussians, read_splats, write_splats, rasterize, rasterize_views
    streams        bake_video, BakeSettings, StreamReader, SplatVideo, open_import, check_stream
    sharing        share, serve, publish, PageText
    measuring      evaluate, psnr, ssim
    lower levels   v3studio.stream, v3studio.calibration

Conventions: quaternions are wxyz; camera axes are OpenCV's (x right, y down, z forward), and `world_to_camera` is 4x4;
the pixel origin is the outer corner of the top-left pixel; images are RGB.

Exports are imported on first use, so `import v3studio` is fast.
"""

import lazy_loader

__version__ = "0.3.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)  # see __init__.pyi
__all__ = sorted([*__all__, "__version__"])
