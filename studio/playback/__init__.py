"""Playback of streams: threads that fetch, decode and dequantize; sound."""

from v3studio.studio.playback.headless import play_headless
from v3studio.studio.playback.sound_player import SoundDevice, SoundPlayer
from v3studio.studio.playback.statistics import PlaybackReport, SkippedGroup
from v3studio.studio.playback.stream_frames import LeftOut, PlayedFrame, StreamFrames

__all__ = [
    "LeftOut",
    "PlaybackReport",
    "PlayedFrame",
    "SkippedGroup",
    "SoundDevice",
    "SoundPlayer",
    "StreamFrames",
    "play_headless",
]
