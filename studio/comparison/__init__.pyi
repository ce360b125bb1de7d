from .flicker import flicker
from .protocols import PROTOCOLS, EvaluationProtocol, find_camera
from .view_quality import HIGHEST_PSNR, ViewPair, ViewQuality, measure_view, padded_box

__all__ = [
    "HIGHEST_PSNR",
    "PROTOCOLS",
    "EvaluationProtocol",
    "ViewPair",
    "ViewQuality",
    "find_camera",
    "flicker",
    "measure_view",
    "padded_box",
]
