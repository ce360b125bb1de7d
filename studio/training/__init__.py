"""Group training: keyframe, motion, fine-tuning (paper section 4)."""

from studio.training.interframe import InterframeResult, interframe_steps, train_interframe
from studio.training.keyframe import keyframe_steps, train_keyframe
from studio.training.settings import LearningRates, TrainSettings
from studio.training.views import TrainingView

__all__ = [
    "InterframeResult",
    "LearningRates",
    "TrainSettings",
    "TrainingView",
    "interframe_steps",
    "keyframe_steps",
    "train_interframe",
    "train_keyframe",
]
