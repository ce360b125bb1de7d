"""Sounds for tests: clicks at known times."""

import wave
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from tests.support.waiting import wait_until
from v3studio.studio.errors import StudioError

CLICK = 0.002
"""Duration of a click in seconds: a burst of 2 kHz."""


def clicks(seconds: float, times: Sequence[float], rate: int = 48_000, channels: int = 1) -> np.ndarray:
    """(samples, channels) float32: a faint hum with a click at each time."""
    samples = 0.002 * np.sin(2 * np.pi * 110 * np.arange(round(seconds * rate)) / rate)
    burst = 0.8 * np.sin(2 * np.pi * 2000 * np.arange(round(CLICK * rate)) / rate)
    for time in times:
        at = round(time * rate)
        part = samples[at : at + len(burst)]
        part += burst[: len(part)]
    return np.repeat(samples[:, None], channels, axis=1).astype(np.float32)


def write_wav(path: Path, samples: np.ndarray, rate: int = 48_000) -> Path:
    """16-bit WAV."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(samples.shape[1])
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes((samples * 32767).astype("<i2").tobytes())
    return path


def write_video(path: Path, frames: int, fps: int, sound: np.ndarray | None, size: tuple[int, int] = (64, 48)) -> Path:
    """A gray video, with sound of 48 kHz unless that is None."""
    with av.open(str(path), "w") as container:
        video: Any = container.add_stream("libx264", rate=fps)
        video.width, video.height, video.pix_fmt = *size, "yuv420p"
        audio: Any = None
        if sound is not None:
            audio = container.add_stream("aac", rate=48_000)
            audio.layout = "mono"
        for index in range(frames):
            picture = np.full((size[1], size[0], 3), 40 + index, np.uint8)
            container.mux(video.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(video.encode())
        for start in range(0, 0 if sound is None else len(sound), 1024):
            part = np.ascontiguousarray(sound[start : start + 1024, 0])[None]
            frame = av.AudioFrame.from_ndarray(part, format="fltp", layout="mono")
            frame.sample_rate, frame.time_base, frame.pts = 48_000, Fraction(1, 48_000), start
            container.mux(audio.encode(frame))
        if sound is not None:
            container.mux(audio.encode())
    return path


def click_times(samples: np.ndarray, rate: int = 48_000) -> list[float]:
    """The times when clicks begin, in seconds: where the loudness first exceeds a third of its highest."""
    loud = np.abs(samples).max(axis=1)
    above = np.flatnonzero(loud > loud.max() / 3)
    apart = np.flatnonzero(np.diff(above, prepend=-rate) > 0.02 * rate)
    return [float(above[index]) / rate for index in apart]


class ArrayPcm:
    """A `Pcm` of these samples."""

    def __init__(self, samples: np.ndarray, rate: int = 48_000) -> None:
        self._data = samples
        self.sample_rate = rate
        self.channels = samples.shape[1]
        self.samples = len(samples)

    def read(self, first: int, count: int) -> np.ndarray:
        out = np.zeros((count, self.channels), np.float32)
        low, high = max(first, 0), min(first + count, self.samples)
        if high > low:
            out[low - first : high - first] = self._data[low:high]
        return out


class FakeOutput:
    """An output device that plays when a test pulls; its clock is the number of samples that were heard.

    Attributes:
        played: what was heard so far.
        latency: samples between a request and when they are heard.
        refuse: raise instead of starting.
    """

    RATE = 48_000

    def __init__(self, latency: int = 0, refuse: bool = False) -> None:
        self.played: list[np.ndarray] = []
        self.latency, self.refuse = latency, refuse
        self.time = 0.0
        self.fill: Callable[[np.ndarray, float], None] | None = None
        self.channels = 0

    def start(self, sample_rate: int, channels: int, fill: Callable[[np.ndarray, float], None]) -> None:
        if self.refuse:
            raise StudioError("sound.unavailable", "no audio output device")
        assert sample_rate == self.RATE
        self.channels, self.fill = channels, fill

    def stop(self) -> None:
        self.fill = None

    def now(self) -> float:
        return self.time

    def pull(self, seconds: float) -> np.ndarray:
        """Play for some time; returns the samples that the player gave meanwhile."""
        wait_until("opened", lambda: self.fill is not None)
        taken = np.empty((round(seconds * self.RATE), self.channels), np.float32)
        self.fill(taken, self.time + self.latency / self.RATE)
        self.time += seconds
        self.played.append(taken)
        return taken
