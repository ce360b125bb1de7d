from .camera_colors import fit_camera_colors
from .camera_refinement import Correction, RefinedCameras, refine_cameras
from .details import Detail
from .interframe import interframe_steps, train_interframe
from .joint import joint_steps, train_jointly
from .keyframe import train_keyframe
from .settings import LearningRates, TrainSettings
from .views import TrainingView

__all__ = [
    "Correction",
    "Detail",
    "LearningRates",
    "RefinedCameras",
    "TrainSettings",
    "TrainingView",
    "fit_camera_colors",
    "interframe_steps",
    "joint_steps",
    "refine_cameras",
    "train_interframe",
    "train_jointly",
    "train_keyframe",
]
