from .camera_colors import fit_camera_colors
from .details import Detail
from .interframe import InterframeResult, interframe_steps, train_interframe
from .keyframe import keyframe_steps, train_keyframe
from .settings import LearningRates, TrainSettings
from .views import TrainingView

__all__ = [
    "Detail",
    "InterframeResult",
    "LearningRates",
    "TrainSettings",
    "TrainingView",
    "fit_camera_colors",
    "interframe_steps",
    "keyframe_steps",
    "train_interframe",
    "train_keyframe",
]
