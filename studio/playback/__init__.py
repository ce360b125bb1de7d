"""Playback of streams without a window: threads that fetch, decode and dequantize; sound."""

from studio.playback.headless import play_headless
from studio.playback.rate_rule import RateRule
from studio.playback.shared import Shared
from studio.playback.sound_player import SoundDevice, SoundPlayer
from studio.playback.statistics import PlaybackReport, SkippedGroup

__all__ = [
    "PlaybackReport",
    "RateRule",
    "Shared",
    "SkippedGroup",
    "SoundDevice",
    "SoundPlayer",
    "play_headless",
]
