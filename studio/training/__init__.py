"""Group training: keyframe, motion, fine-tuning (paper section 4)."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.training.camera_colors import FittedColors, fit_camera_colors
    from studio.training.details import Detail
    from studio.training.interframe import InterframeResult, interframe_steps, train_interframe
    from studio.training.keyframe import keyframe_steps, train_keyframe
    from studio.training.settings import LearningRates, TrainSettings
    from studio.training.views import TrainingView

__all__ = [
    "Detail",
    "FittedColors",
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

lazy_exports(__name__)
