"""Encodes sound as AAC-LC in an MP4 file."""

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np

BIT_RATE = {1: 96_000, 2: 160_000}
"""Bits per second by number of channels: little beside the frames, and far above where AAC-LC is audibly lossy."""


class SoundEncoder:
    """Adds an AAC track of 1 or 2 channels to an MP4 file that is open in PyAV for writing, and encodes into it. The
    container's edit list hides the encoder's delay, so that sample 0 is at time 0."""

    def __init__(self, container: Any, sample_rate: int, channels: int) -> None:
        import av

        self._av = av
        self._out = container
        self._rate = sample_rate
        self._layout = "mono" if channels == 1 else "stereo"
        stream = container.add_stream("aac", rate=sample_rate)
        stream.layout = self._layout
        stream.bit_rate = BIT_RATE[channels]
        stream.codec_context.options = {"flags": "+bitexact"}  # without the encoder's version
        stream.codec_context.thread_count = 1
        self._stream = stream
        self.done = 0  # samples

    def add(self, samples: np.ndarray) -> None:
        """Encode the next samples, (n, channels) float32; values beyond -1 to 1 are clipped."""
        planar = np.ascontiguousarray(np.clip(samples, -1, 1).T, dtype=np.float32)
        frame = self._av.AudioFrame.from_ndarray(planar, format="fltp", layout=self._layout)
        frame.sample_rate, frame.time_base, frame.pts = self._rate, Fraction(1, self._rate), self.done
        self.done += len(samples)
        self._out.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Encode the remaining samples; the container stays open."""
        self._out.mux(self._stream.encode(None))


def encode_sound(blocks: Iterable[np.ndarray], path: str, sample_rate: int, channels: int) -> int:
    """Write a sound, blocks of (n, channels) float32, as an MP4 of one AAC-LC track; returns the number of samples."""
    import av

    options = {"fflags": "+bitexact", "movflags": "+faststart"}
    with av.open(path, "w", format="mp4", options=options) as container:
        encoder = SoundEncoder(container, sample_rate, channels)
        for block in blocks:
            encoder.add(block)
        encoder.close()
    return encoder.done
