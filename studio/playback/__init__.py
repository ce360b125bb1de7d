"""Playing a stream: threads for fetching, decoding and dequantizing, and a clock. It knows no window.

`Player` serves a viewport, `play_headless` a command line.
"""

from studio.playback.headless import play_headless
from studio.playback.pipeline import PlayedFrame
from studio.playback.player import Player
from studio.playback.shared import Shared
from studio.playback.statistics import FrameStats, PlaybackReport, SkippedGroup, Spread

__all__ = ["FrameStats", "PlaybackReport", "PlayedFrame", "Player", "Shared", "SkippedGroup", "Spread", "play_headless"]
