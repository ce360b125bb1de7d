"""Sound: reading files, cutting them to the frames of a take, encoding. Samples are float32 (samples, channels)."""

from v3studio.studio.audio.cut import Cut, cut_sound
from v3studio.studio.audio.encode import encode_sound
from v3studio.studio.audio.pcm import Pcm
from v3studio.studio.audio.sound_file import SAMPLE_RATE, SoundFile

__all__ = ["SAMPLE_RATE", "Cut", "Pcm", "SoundFile", "cut_sound", "encode_sound"]
