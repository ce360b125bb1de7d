"""The sound of a file: WAV, or anything else that FFmpeg reads, such as a camera's video."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.capture.media import open_media, start_of, video_stream
from v3studio.studio.errors import StudioError

SAMPLE_RATE = 48_000
"""Samples per second to which sound is resampled: the rate of video production, which every device plays."""


class SoundFile:
    """A file with sound. Time 0 is its first video frame, or, without video, its beginning; `duration` is from there,
    in seconds, None if the file does not say. `blocks` returns `channels` channels: 1 for mono, otherwise 2. Of several
    mono streams, as recorders write them, the first two are left and right."""

    def __init__(self, path: Path) -> None:
        import av

        self.path = Path(path)
        try:
            with open_media(self.path) as container:
                if not container.streams.audio:
                    problem = "the file has no sound"
                    fix = "Choose another file or camera in capture.audio, or set it to null."
                    raise StudioError("audio.no_sound", problem, file=self.path, fix=fix, setting="capture.audio")
                stream = container.streams.audio[0]
                if stream.codec_context is None:
                    raise ValueError("FFmpeg does not know its codec")
                known = [each for each in container.streams.audio if each.codec_context is not None]
                mono = [each.index for each in known if each.channels == 1]
                self._streams = mono[:2] if len(mono) == len(known) else [stream.index]
                self.channels = 1 if stream.channels == 1 and len(self._streams) == 1 else 2
                video = video_stream(container)
                self._zero = start_of(video) if video is not None else 0.0
                self.duration = _end(container, stream)
                if self.duration is not None:
                    self.duration -= self._zero
                rate, channels = stream.rate, stream.channels
        except (av.FFmpegError, OSError, ValueError) as error:
            raise self._unreadable(error) from None
        layout = {1: "mono", 2: "stereo"}.get(channels, f"{channels} channels")
        if len(self._streams) > 1:
            layout = f"stereo of the first 2 of {len(mono)} mono streams"
        length = "" if self.duration is None else f", {self.duration:.2f} s"
        self.description = f"{rate:g} Hz, {layout}{length}"

    def blocks(self) -> Iterator[tuple[int, np.ndarray]]:
        """The sound at `SAMPLE_RATE`, block by block without gaps, decoded on the way: number of the block's first
        sample, counted from time 0 (may be negative), and the samples, (n, channels) float32. StudioError:
        `audio.unreadable`."""
        import av

        layout = "mono" if self.channels == 1 or len(self._streams) > 1 else "stereo"
        position: int | None = None
        try:
            with open_media(self.path) as container:
                resamplers = {
                    index: av.AudioResampler(format="fltp", layout=layout, rate=SAMPLE_RATE) for index in self._streams
                }
                waiting = {index: np.zeros((0, 1), np.float32) for index in self._streams}  # of several streams
                for index, frame in chain(self._frames(container), ((index, None) for index in self._streams)):
                    if position is None and frame is not None:
                        start = frame.time if frame.time is not None else 0.0
                        position = round((start - self._zero) * SAMPLE_RATE)
                    if frame is not None:
                        frame.pts = None  # resample by counting; the time stamps of many files are rounded
                    for piece in resamplers[index].resample(frame):  # None flushes it
                        samples = np.ascontiguousarray(piece.to_ndarray().T, dtype=np.float32)
                        np.nan_to_num(samples, copy=False, posinf=1.0, neginf=-1.0)  # the encoder refuses them
                        if len(waiting) > 1:
                            waiting[index] = np.concatenate([waiting[index], samples])
                            count = min(map(len, waiting.values()))
                            samples = np.concatenate([own[:count] for own in waiting.values()], axis=1)
                            waiting = {key: own[count:] for key, own in waiting.items()}
                        if len(samples) and position is not None:
                            yield position, samples
                            position += len(samples)
        except (av.FFmpegError, OSError, ValueError) as error:
            raise self._unreadable(error) from None

    def _frames(self, container: Any) -> Iterator[tuple[int, Any]]:
        for packet in container.demux([container.streams[index] for index in self._streams]):
            for frame in packet.decode():
                yield packet.stream.index, frame

    def _unreadable(self, error: Exception) -> StudioError:
        problem = f"the sound cannot be read ({getattr(error, 'strerror', None) or error})"
        fix = "Copy it again, or convert it to WAV."
        return StudioError("audio.unreadable", problem, file=self.path, fix=fix)


def _end(container: Any, stream: Any) -> float | None:
    if stream.duration is not None:
        return start_of(stream) + float(stream.duration * stream.time_base)
    return None if container.duration is None else start_of(stream) + container.duration / 1e6
