"""The sound of a cast: that of its streams, each from its start on, over and over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studio.stream import StreamSound


@dataclass(frozen=True)
class Voice:
    """A stream's sound. `start` and `period` are samples."""

    sound: StreamSound
    start: int
    period: int


@dataclass(frozen=True)
class CastSound:
    """See the module; a `Pcm` of two channels. All voices have its sample rate."""

    voices: Sequence[Voice]
    sample_rate: int
    samples: int
    channels: int = 2

    def read(self, first: int, count: int) -> np.ndarray:
        """See `Pcm`."""
        out = np.zeros((count, self.channels), np.float32)
        for voice in self.voices:
            done = max(voice.start - first, 0)
            while done < count:
                at = (first + done - voice.start) % voice.period
                length = min(count - done, voice.period - at)
                out[done : done + length] += voice.sound.read(at, length)  # of one channel, to both
                done += length
        return np.clip(out, -1, 1)

    def copy(self) -> CastSound:
        """Another one, to read at two places in turn without seeking."""
        return replace(self, voices=[replace(voice, sound=voice.sound.copy()) for voice in self.voices])

    def close(self) -> None:
        for voice in self.voices:
            voice.sound.close()
