"""Random access into a video by frame index, exact also with B-frames, and fast when read forwards."""

from __future__ import annotations

import bisect
import threading
from pathlib import Path
from typing import Any

import numpy as np

from studio.errors import StudioError

# swscale: bicubic, chroma interpolated horizontally too, exact rounding. The default repeats chroma samples, which
# shows at silhouettes and costs about 1 dB of color accuracy in 4:2:0 footage.
_SWS_FLAGS = 0x4 | 0x2000 | 0x40000
_MATRICES = {"bt601": 5, "bt709": 1}  # swscale's SWS_CS_ITU601 and SWS_CS_ITU709


class VideoReader:
    """One video file. Frames are numbered from 0 in presentation order. Thread safe (one decoder, one lock).

    Attributes:
        path: the file.
        width, height: pixels, after the rotation that the file asks for (multiples of 90 degrees).
        frame_count: frames that the container lists.
        fps: average frames a second, or None.
        has_alpha: frames have an alpha channel.

    Raises:
        StudioError: the file is missing, not a video, truncated so that it cannot be opened, or its first frame cannot
            be decoded.
    """

    def __init__(self, path: Path, color_matrix: str = "auto") -> None:
        self.path = Path(path)
        self._matrix = color_matrix
        self._lock = threading.RLock()
        self._container: Any = None
        self._stream: Any = None
        self._frames: Any = None
        self._next = 0  # index of the frame that the decoder hands out next
        self._current: tuple[int, Any] | None = None
        self._timestamps: list[int] | None = None  # sorted presentation times, None until a seek needs them
        self._keyframes: list[int] = []  # indices of keyframes
        self._seekable = True
        with self._lock:
            self._open()
            stream: Any = self._stream
            self.fps = float(stream.average_rate) if stream.average_rate else None
            entries = stream.index_entries
            listed = [entry for entry in entries if not entry.is_discard] if entries is not None else []
            # The index that Matroska and others keep lists keyframes only; MP4's lists every frame.
            whole = len(listed) > 1 and stream.frames > 0 and len(entries) == stream.frames
            self.frame_count = len(listed) if whole else self._scan()
            if self.frame_count == 0:
                self.close()
                raise StudioError(f"The video {self.path} has no frames.")
            frame = self._decode(0)
            self._turns = (round(frame.rotation / 90) % 4) if frame.rotation else 0
            turned = self._turns % 2 == 1
            self.width, self.height = (frame.height, frame.width) if turned else (frame.width, frame.height)
            self._coded = (frame.width, frame.height)
            self.has_alpha = any(part.is_alpha for part in frame.format.components)

    @property
    def is_open(self) -> bool:
        """Whether a decoder is held now."""
        return self._container is not None

    def close(self) -> None:
        """Give the decoder back; reading opens it again."""
        with self._lock:
            if self._container is not None:
                self._container.close()
            self._container = self._stream = self._frames = self._current = None
            self._next = 0

    def read(self, index: int) -> np.ndarray:
        """Frame `index` as (H, W, 3) RGB or, with `has_alpha`, (H, W, 4) RGBA, uint8, full range.

        Raises:
            StudioError: there is no such frame, or it cannot be decoded.
        """
        if not 0 <= index < self.frame_count:
            raise StudioError(f"The video {self.path} has no frame {index}; it has 0 to {self.frame_count - 1}.")
        with self._lock:
            frame = self._decode(index)
            if (frame.width, frame.height) != self._coded:
                raise StudioError(
                    f"The video {self.path} changes its size to {frame.width}x{frame.height} in frame {index}; "
                    "encode it again at one size."
                )
            try:
                image = self._to_rgb(frame)
            except (OSError, ValueError) as error:
                raise StudioError(f"Frame {index} of {self.path} cannot be converted to RGB ({error}).") from None
        return np.ascontiguousarray(np.rot90(image, self._turns)) if self._turns else image

    def _to_rgb(self, frame: Any) -> np.ndarray:
        if frame.format.name == "gray":
            # Stored gray values are the values: no range conversion.
            return np.repeat(frame.to_ndarray()[:, :, None], 3, axis=2)
        options: dict[str, Any] = {"interpolation": _SWS_FLAGS}
        if self._matrix != "auto" and not frame.format.is_rgb:
            options["src_colorspace"] = _MATRICES[self._matrix]
        return frame.to_ndarray(format="rgba" if self.has_alpha else "rgb24", **options)

    def _open(self) -> None:
        import av

        self.close()
        if not self.path.is_file():
            raise StudioError(f"The video {self.path} is not there.")
        try:
            container = av.open(str(self.path))
        except (av.error.FFmpegError, OSError, ValueError):
            raise StudioError(
                f"The video {self.path} cannot be opened: it is truncated or not a video; copy or encode it again."
            ) from None
        if not container.streams.video:
            container.close()
            raise StudioError(f"The file {self.path} has no video in it.")
        self._container = container
        self._stream = container.streams.video[0]
        # One thread a decoder: a capture keeps many decoders open, and frame threads would hold a frame buffer each.
        self._stream.codec_context.thread_count = 1
        self._frames = container.decode(self._stream)
        self._next = 0

    def _scan(self) -> int:
        """Read all packets once (nothing is decoded) for the exact presentation times; returns the frame count."""
        import av

        times: list[int] = []
        keys: list[int] = []
        known = True
        try:
            with av.open(str(self.path)) as container:
                stream = container.streams.video[0]
                for packet in container.demux(stream):
                    if packet.size == 0 or packet.is_discard:
                        continue
                    if packet.pts is None:
                        known = False
                        times.append(len(times))
                        continue
                    times.append(packet.pts)
                    if packet.is_keyframe:
                        keys.append(packet.pts)
        except (av.error.FFmpegError, OSError) as error:
            raise StudioError(f"The video {self.path} cannot be read ({error}); copy or encode it again.") from None
        if not known or len(set(times)) != len(times):
            self._seekable = False  # no usable times (raw streams, some AVI): count frames from the start instead
            self._timestamps = []
            return len(times)
        times.sort()
        self._timestamps = times
        self._keyframes = sorted(bisect.bisect_left(times, key) for key in keys)
        return len(times)

    def _decode(self, index: int) -> Any:
        """The decoded frame `index`; moves the decoder as little as it can."""
        if self._current is not None and self._current[0] == index:
            return self._current[1]
        if self._container is None:
            self._open()
        if index != self._next and not self._forward_is_best(index):
            self._seek(index)
        while True:
            at, frame = self._step()
            self._current = (at, frame)
            if at == index:
                return frame

    def _forward_is_best(self, index: int) -> bool:
        if index < self._next:
            return False
        if index - self._next < 8 or not self._seekable:
            return True
        if self._timestamps is None:
            self._scan()
        place = bisect.bisect_right(self._keyframes, index) - 1
        return place < 0 or self._keyframes[place] <= self._next

    def _step(self) -> tuple[int, Any]:
        import av

        at = self._next
        try:
            frame = next(self._frames)
        except (StopIteration, av.error.EOFError):
            self.close()
            raise StudioError(
                f"The video {self.path} ends after {at} of its {self.frame_count} frames: it is truncated; copy it "
                f"again, or use frames below {at} only."
            ) from None
        except (av.error.FFmpegError, OSError, ValueError) as error:
            self.close()
            reason = getattr(error, "strerror", None) or error
            raise StudioError(
                f"Frame {at} of {self.path} cannot be decoded ({reason}); copy or encode the video again."
            ) from None
        if frame.is_corrupt:
            self.close()
            raise StudioError(f"Frame {at} of {self.path} is damaged; copy or encode the video again.")
        self._next = at + 1
        return at, frame

    def _seek(self, index: int) -> None:
        """Place the decoder so that stepping forwards reaches `index`."""
        import av

        if self._timestamps is None:
            self._scan()
        place = bisect.bisect_right(self._keyframes, index) - 1 if self._seekable else -1
        if place <= 0:
            self._open()
            return
        assert self._timestamps is not None
        start = self._keyframes[place]
        try:
            self._container.seek(self._timestamps[start], stream=self._stream, backward=True, any_frame=False)
            self._frames = self._container.decode(self._stream)
            # Frames of an open group that precede the keyframe in time may come first, damaged: pass over them.
            for frame in self._frames:
                if frame.pts is None or frame.pts > self._timestamps[start]:
                    break
                if frame.pts < self._timestamps[start]:
                    continue
                self._frames = _chain(frame, self._frames)
                self._next = start
                self._current = None
                return
        except (av.error.FFmpegError, OSError, ValueError):
            pass
        self._open()  # the container's seek index is unusable: the slow way is still exact


def _chain(first: Any, rest: Any) -> Any:
    yield first
    yield from rest
