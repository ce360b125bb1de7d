"""Sound: reading files, cutting them to the frames of a take, encoding. Samples are float32 (samples, channels)."""

from studio.audio.cut import Cut, cut_sound
from studio.audio.encode import encode_sound
from studio.audio.pcm import Pcm
from studio.audio.sound_file import SAMPLE_RATE, SoundFile

__all__ = ["SAMPLE_RATE", "Cut", "Pcm", "SoundFile", "cut_sound", "encode_sound"]
