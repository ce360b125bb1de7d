"""Playback of streams: threads that fetch, decode and dequantize, and a clock. Independent of any window.

`Player` is for viewports; `play_headless` is for command lines and measurements.
"""

from studio.playback.headless import play_headless
from studio.playback.pipeline import PlayedFrame
from studio.playback.player import Player
from studio.playback.rate_rule import RateRule
from studio.playback.shared import Shared
from studio.playback.statistics import FrameStats, PlaybackReport, SkippedGroup, Spread

__all__ = [
    "FrameStats",
    "PlaybackReport",
    "PlayedFrame",
    "Player",
    "RateRule",
    "Shared",
    "SkippedGroup",
    "Spread",
    "play_headless",
]
