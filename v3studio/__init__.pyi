from pipelines.config import Config, load_config
from pipelines.events import Event, Finished, Metrics, Progress, StageFinished, Warned
from pipelines.runs.runner import run, status
from pipelines.runs.staleness import StageStatus
from pipelines.share.page import PageText
from pipelines.share.serving import Serving, serve
from pipelines.share.sharing import Shared, publish, share
from pipelines.takes.take import Take
from pipelines.takes.videos import trained_video
from studio.calibration import (
    CalibrationResult,
    CalibrationTarget,
    TiePoint,
    align_rigs,
    calibrate_from_images,
    calibrate_from_target,
    calibrate_from_tie_points,
    compare_rigs,
    detect_target,
    read_tie_points,
    write_target_pdf,
)
from studio.calibration.settings import CalibrateSettings
from studio.camera_files import read_rig, write_rig
from studio.cameras import Camera, Rig, orbit
from studio.capture import CaptureSettings, Footage, FootageView, open_footage
from studio.comparison import evaluate
from studio.errors import Cancelled, Message, StudioError
from studio.formats import read_splats, write_splats
from studio.formats.baking import bake_video
from studio.formats.sequence import open_import
from studio.gaussians import Gaussians
from studio.masks import FunctionMaskSource, MaskFunction, MaskSource
from studio.meshing import InitResult, Mesh, initialize_points
from studio.meshing.settings import InitializeSettings
from studio.metrics import psnr, ssim
from studio.rasterizer import Render, available_backends, rasterize
from studio.splat_video import SplatVideo
from studio.stream import BakeSettings, Manifest, StreamReader, bake_group, write_manifest
from studio.stream.integrity import check_stream
from studio.stream.publish import Published
from studio.training import TrainingView, TrainSettings, train_interframe, train_keyframe

__version__: str

__all__ = [
    "BakeSettings",
    "CalibrateSettings",
    "CalibrationResult",
    "CalibrationTarget",
    "Camera",
    "Cancelled",
    "CaptureSettings",
    "Config",
    "Event",
    "Finished",
    "Footage",
    "FootageView",
    "FunctionMaskSource",
    "Gaussians",
    "InitResult",
    "InitializeSettings",
    "Manifest",
    "MaskFunction",
    "MaskSource",
    "Mesh",
    "Message",
    "Metrics",
    "PageText",
    "Progress",
    "Published",
    "Render",
    "Rig",
    "Serving",
    "Shared",
    "SplatVideo",
    "StageFinished",
    "StageStatus",
    "StreamReader",
    "StudioError",
    "Take",
    "TiePoint",
    "TrainSettings",
    "TrainingView",
    "Warned",
    "__version__",
    "align_rigs",
    "available_backends",
    "bake_group",
    "bake_video",
    "calibrate_from_images",
    "calibrate_from_target",
    "calibrate_from_tie_points",
    "check_stream",
    "compare_rigs",
    "detect_target",
    "evaluate",
    "initialize_points",
    "load_config",
    "open_footage",
    "open_import",
    "orbit",
    "psnr",
    "publish",
    "rasterize",
    "read_rig",
    "read_splats",
    "read_tie_points",
    "run",
    "serve",
    "share",
    "ssim",
    "status",
    "train_interframe",
    "train_keyframe",
    "trained_video",
    "write_manifest",
    "write_rig",
    "write_splats",
    "write_target_pdf",
]
