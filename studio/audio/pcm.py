"""Decoded sound with random access."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Pcm(Protocol):
    """Sound by sample number, of 1 or 2 channels; sample 0 sounds when frame 0 appears. `samples` are per channel."""

    sample_rate: int
    channels: int
    samples: int

    def read(self, first: int, count: int) -> np.ndarray:
        """(count, channels) float32, -1 to 1, from sample `first` on; silence outside of the sound."""


@dataclass
class _Part:
    whole: Pcm
    first: int
    samples: int
    sample_rate: int
    channels: int

    def read(self, first: int, count: int) -> np.ndarray:
        out = np.zeros((count, self.channels), np.float32)
        low, high = max(first, 0), min(first + count, self.samples)
        if high > low:
            out[low - first : high - first] = self.whole.read(self.first + low, high - low)
        return out


def part_of(whole: Pcm, start: float, seconds: float) -> Pcm:
    """The sound from `start` on, for `seconds`; both in seconds. A negative start begins with silence."""
    rate = whole.sample_rate
    return _Part(whole, round(start * rate), round(seconds * rate), rate, whole.channels)
