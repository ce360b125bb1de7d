"""The sound of a stream: decoded from a verified file, a part at a time."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from typing import Any

import av
import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.stream.manifest import AudioEntry
from v3studio.studio.stream.sources.source import damaged
from v3studio.studio.stream.video import UNREADABLE

_FRAME = 1024  # samples of an AAC-LC frame
_PREROLL = 4 * _FRAME  # the first frame after seeking lacks its overlap
_AHEAD = 8 * _FRAME  # reads that go on a little later decode on instead of seeking


class StreamSound:
    """A stream's sound by sample number; sample 0 is at frame 0, whatever the file's `start`. Thread safe.

    It holds the whole verified file `data` and at most a few decoded frames besides what `read` returns. `samples`
    counts them from frame 0 to the end of the sound; `name`, path or URL, is for messages. StudioError
    (`stream.wrong_sound`) if it is not an MP4 with one track of that codec, rate and number of channels.
    """

    def __init__(self, data: bytes, entry: AudioEntry, name: str) -> None:
        self.entry = entry
        self.sample_rate = entry.sample_rate
        self.channels = entry.channels
        self._skip = round(entry.start * entry.sample_rate)  # samples of silence before the file's sound
        self.samples = self._skip + entry.samples
        self._name = name
        self._lock = threading.Lock()
        self._pieces: Iterator[tuple[int, np.ndarray]] = iter(())
        self._held: list[tuple[int, np.ndarray]] = []  # decoded and not yet passed
        self._next = 0  # sample of the file that decoding continues at
        self._data = data
        try:
            self._container: Any = self._open()
        except UNREADABLE as error:
            raise self._damaged(error) from None
        streams = self._container.streams
        track = None
        if len(streams) == 1 and streams.audio and streams.audio[0].codec_context is not None:
            context = streams.audio[0].codec_context
            track = (context.codec.canonical_name, context.sample_rate, context.layout.nb_channels)
        wanted = (entry.codec, entry.sample_rate, entry.channels)
        if track != wanted:
            self._container.close()
            words = "no single sound track" if track is None else _words(*track)
            raise damaged(
                "stream.wrong_sound", f"{words}; the manifest says {_words(*wanted)}", name, track, expected=wanted
            )
        self._pieces = self._decoded(0)

    def _open(self) -> Any:
        return av.open(io.BytesIO(self._data), "r", format="mp4")

    def read(self, first: int, count: int) -> np.ndarray:
        """The samples as `Pcm.read` describes them: (count, channels) float32 from `first` on, silence outside;
        StudioError if damaged."""
        out = np.zeros((count, self.channels), np.float32)
        low, high = max(first - self._skip, 0), min(first + count - self._skip, self.entry.samples)
        if high <= low:
            return out
        with self._lock:
            try:
                self._fill(out, low, high, self._skip - first)
            except UNREADABLE as error:
                raise self._damaged(error) from None
        return out

    def _fill(self, out: np.ndarray, low: int, high: int, shift: int) -> None:
        """Decode samples `low` to `high` of the file into `out`, sample s to row s + shift."""
        earliest = self._held[0][0] if self._held else self._next
        if not earliest <= low <= self._next + _AHEAD:
            self._restart(low)
        kept = []
        reached = low
        while reached < high:
            if self._held:
                start, piece = self._held.pop(0)
            else:
                decoded = next(self._pieces, None)
                if decoded is None:
                    raise ValueError(f"it ends after {self._next} of {self.entry.samples} samples")
                start, piece = decoded
                self._next = start + len(piece)
            end = start + len(piece)
            if start > reached:
                raise ValueError(f"samples {reached} to {start - 1} are missing")
            if end > reached:
                stop = min(end, high)
                out[reached + shift : stop + shift] = piece[reached - start : stop - start]
                reached = stop
            if end > high:
                kept = [(start, piece)]
        self._held = kept + self._held

    def _restart(self, sample: int) -> None:
        """Decode from `sample` of the file, or from somewhat earlier."""
        self._held = []
        at = max(sample - _PREROLL, 0)
        if at == 0:  # FFmpeg does not seek to what comes before time 0, which the first frame needs
            self._container.close()
            self._container = self._open()
        else:
            stream = self._container.streams.audio[0]
            self._container.seek(int(at / self.sample_rate / stream.time_base), stream=stream, backward=True)
        self._pieces = self._decoded(at)
        self._next = at

    def _decoded(self, at: int) -> Iterator[tuple[int, np.ndarray]]:
        """Pieces (first sample, samples) of the file; after a seek into the middle, without the first one."""
        drop = at > 0
        for frame in self._container.decode(self._container.streams.audio[0]):
            if frame.format.name != "fltp" or frame.layout.nb_channels != self.channels:
                raise ValueError(f"a frame is {frame.format.name} with {frame.layout.nb_channels} channels")
            if frame.sample_rate != self.sample_rate or frame.pts is None:
                raise ValueError(f"a frame has {frame.sample_rate} Hz, or no time")
            start = round(frame.pts * frame.time_base * self.sample_rate)
            if drop:
                drop = False
                continue
            piece = frame.to_ndarray().T
            if not np.isfinite(piece).all():
                raise ValueError("a sample is not finite")
            yield start, piece

    def copy(self) -> StreamSound:
        """Another decoder of the same file, to read at two places in turn without seeking."""
        return StreamSound(self._data, self.entry, self._name)

    def close(self) -> None:
        """Release the decoder."""
        with self._lock:
            self._pieces, self._held = iter(()), []
            self._container.close()

    def _damaged(self, error: BaseException) -> StudioError:
        return damaged("stream.sound_damaged", f"the sound is damaged ({error})", self._name)


def _words(codec: str, sample_rate: int, channels: int) -> str:
    return f"{codec} of {sample_rate} Hz and {channels} channel{'s' * (channels != 1)}"
