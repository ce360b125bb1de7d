from .evaluate import evaluate
from .metrics import EVALUATED, FLICKER, HIGHEST_PSNR, METRICS, Metric, measure
from .protocols import PROTOCOLS, EvaluationProtocol, find_camera
from .view_pair import Residual, ViewPair, flicker, flicker_of, padded_box

__all__ = [
    "EVALUATED",
    "FLICKER",
    "HIGHEST_PSNR",
    "METRICS",
    "PROTOCOLS",
    "EvaluationProtocol",
    "Metric",
    "Residual",
    "ViewPair",
    "evaluate",
    "find_camera",
    "flicker",
    "flicker_of",
    "measure",
    "padded_box",
]
