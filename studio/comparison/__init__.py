"""Measuring drawn frames against footage by a stated protocol, so that results can be compared with those of others."""

from typing import TYPE_CHECKING

from studio.lazy import lazy_exports

if TYPE_CHECKING:
    from studio.comparison.flicker import flicker
    from studio.comparison.protocols import PROTOCOLS, EvaluationProtocol, find_camera
    from studio.comparison.view_quality import HIGHEST_PSNR, ViewPair, ViewQuality, measure_view, padded_box

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

lazy_exports(__name__)
