"""Playback of streams: threads that fetch, decode and dequantize; sound."""

from studio.playback.headless import play_headless
from studio.playback.rate_rule import RateRule
from studio.playback.sound_player import SoundDevice, SoundPlayer
from studio.playback.statistics import PlaybackReport, SkippedGroup
from studio.playback.stream_frames import LeftOut, PlayedFrame, StreamFrames

__all__ = [
    "LeftOut",
    "PlaybackReport",
    "PlayedFrame",
    "RateRule",
    "SkippedGroup",
    "SoundDevice",
    "SoundPlayer",
    "StreamFrames",
    "play_headless",
]
