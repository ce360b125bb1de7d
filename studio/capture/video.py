"""Frame-accurate random access to videos, including those with B-frames; sequential reading is fast."""

import bisect
import functools
import itertools
import threading
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.capture.chroma_grid import chroma_grid
from v3studio.studio.capture.media import decoded, open_media, open_packets, video_stream
from v3studio.studio.capture.patterns import interval_of
from v3studio.studio.capture.transfer import TransferFunction, eight_bit
from v3studio.studio.chroma import ChromaSampling
from v3studio.studio.errors import StudioError

# swscale flags: bicubic, full horizontal chroma interpolation, accurate rounding. The default repeats chroma samples,
# which is visible at silhouettes and reduces the color accuracy of 4:2:0 footage by about 1 dB.
_SWS_FLAGS = 0x4 | 0x2000 | 0x40000
_MATRICES = {"bt601": 5, "bt709": 1}  # swscale's SWS_CS_ITU601 and SWS_CS_ITU709
_TAGS = {1: "bt709", 2: "", 5: "bt601", 6: "bt601"}  # by FFmpeg's AVColorSpace
_WIDE = {9: "BT.2020", 11: "DCI-P3", 12: "Display P3"}  # FFmpeg's AVCOL_PRI_BT2020, _SMPTE431 and _SMPTE432
_HDR = {16: "PQ", 18: "HLG"}  # FFmpeg's AVCOL_TRC_SMPTE2084 and AVCOL_TRC_ARIB_STD_B67
_SQUARE = 0.01
_GAP = 0.5  # of an interval: by how much times may be off without a frame being missing
_JITTER = 0.25  # of an interval: by how much times may be off at a constant rate
_DRIFT = 0.1  # of an interval: by how much the rate that a file says may be off at its end
_EMPTY_PACKET = 8  # bytes
_ENCODE_AGAIN = "Copy or encode the video again."


class VideoReader:
    """Reads one video file. Frames are numbered from 0 in presentation order. Thread safe (one decoder, one lock).

    Args:
        color_matrix: YUV to RGB: "auto" (the file's tag, BT.601 if untagged), "bt601" or "bt709".
        transfer: what the values are, see `CaptureSettings.transfer`.

    Attributes:
        width, height: in square pixels, after the file's display rotation (multiples of 90 degrees).
        frame_count: number of frames at a constant rate. A frame that the file skips or repeats without data is the one
            before it.
        fps: frame rate in frames per second, or None.
        note: a clause on what is unusual about the file and how it is read; otherwise "".
        has_alpha: whether frames have an alpha channel.
        tag: the YUV to RGB matrix that the file says it has, as for `color_matrix`; "" if it says none, None if it has
            RGB or another matrix.
    """

    def __init__(self, path: Path, color_matrix: str = "auto", transfer: TransferFunction = "auto") -> None:
        self.path = Path(path)
        self._matrix = color_matrix
        self._transfer: TransferFunction = transfer
        self._lock = threading.RLock()
        self._container: Any = None
        self._stream: Any = None
        self._frames: Any = None
        self._next = 0  # index of the frame that the decoder returns next
        self._current: tuple[int, Any] | None = None
        self._timestamps: list[int] | None = None  # sorted presentation times; None until a seek needs them
        self._keyframes: list[int] = []  # indices of keyframes
        self._seekable = True
        self._shown: list[int] | None = None  # of each frame the index in the file, if they differ
        self.note = ""
        with self._lock:
            self._open()
            stream: Any = self._stream
            self.fps = float(stream.average_rate) if stream.average_rate else None
            entries = stream.index_entries
            listed = [entry for entry in entries if not entry.is_discard] if entries is not None else []
            # The index of an MP4 lists every frame; those of Matroska and other containers list only keyframes.
            whole = len(listed) > 1 and stream.frames > 0 and len(entries) == stream.frames
            self._coded_count = len(listed) if whole else self._scan()
            self.frame_count = self._coded_count
            times = [entry.timestamp for entry in listed] if whole else []
            self._without_empty([entry.size for entry in listed] if whole else self._sizes, times)
            if self._shown is None:
                self._at_constant_rate(sorted(times) if whole else None)
            else:
                self.frame_count = len(self._shown)
            if self.frame_count == 0:
                self.close()
                raise StudioError("footage.video_empty", "the video has no frames", file=self.path)
            frame = self._decode(0)
            self._turns, self._mirrored = _display(frame)
            self.tag = None if frame.format.is_rgb else _TAGS.get(int(frame.colorspace))
            self._coded = (frame.width, frame.height)
            self._square = _with_square_pixels(*self._coded, stream.sample_aspect_ratio)
            self.width, self.height = self._square[:: -1 if self._turns % 2 else 1]
            self.note = "; ".join(filter(None, (self.note, *_unusual(self._container, stream, frame))))
            self.has_alpha = any(part.is_alpha for part in frame.format.components)

    def close(self) -> None:
        """Close the decoder. The next read opens it again."""
        with self._lock:
            if self._container is not None:
                self._container.close()
            self._container = self._stream = self._frames = self._current = None
            self._next = 0

    def read(self, index: int) -> np.ndarray:
        """Frame as (H, W, 3) RGB or, with `has_alpha`, RGBA; uint8, full range. Raises StudioError with its `frame`."""
        if not 0 <= index < self.frame_count:
            problem = f"no frame {index}; the video has frames 0 to {self.frame_count - 1}"
            raise StudioError("footage.no_such_frame", problem, file=self.path, value=index, frame=index)
        with self._lock:
            frame = self._decode(self._shown[index] if self._shown is not None else index)
            if (frame.width, frame.height) != self._coded:
                raise StudioError(
                    "footage.size_changed",
                    f"the size changes from {self._coded[0]}x{self._coded[1]} to {frame.width}x{frame.height} at frame "
                    f"{index}",
                    file=self.path,
                    value=(frame.width, frame.height),
                    fix="Re-encode the video at a single size.",
                    frame=index,
                    expected=self._coded,
                )
            try:
                image = self._to_rgb(frame)
            except (OSError, ValueError) as error:
                problem = f"cannot convert frame {index} to RGB ({error})"
                raise StudioError(
                    "footage.frame_undecodable", problem, file=self.path, fix=_ENCODE_AGAIN, frame=index
                ) from None
        image = image[:, ::-1] if self._mirrored else image
        return np.ascontiguousarray(np.rot90(image, self._turns))

    def use_matrix(self, color_matrix: str) -> None:
        """Read the rest of the file with this matrix, "bt601" or "bt709"."""
        self._matrix = color_matrix

    @functools.cached_property
    def chroma(self) -> ChromaSampling | None:
        """Chroma grid of the frames that `read` returns; None: no subsampling, or see `chroma_grid`."""
        if self._transfer not in ("auto", "srgb") or self._square != self._coded or self._mirrored:
            return None  # the loss would have to subsample before the curve, or before stretching
        with open_media(self.path) as container:
            stream = video_stream(container)
            assert stream is not None  # else `__init__` would have raised
            frame = next(decoded(container, stream))
            grid = chroma_grid(frame, self._to_rgb, self._matrix)
        return grid and grid.rotated(self._turns, *self._coded)

    def _to_rgb(self, frame: Any) -> np.ndarray:
        options: dict[str, str | int] = {"interpolation": _SWS_FLAGS}
        if self._square != self._coded:
            options |= {"width": self._square[0], "height": self._square[1]}
        if frame.format.name == "gray":
            # Gray values are used as stored, without range conversion.
            return np.repeat(frame.to_ndarray(format="gray", **options)[:, :, None], 3, axis=2)
        if self._matrix != "auto" and not frame.format.is_rgb:
            options["src_colorspace"] = _MATRICES[self._matrix]
        if self._transfer in ("auto", "srgb"):
            return frame.to_ndarray(format="rgba" if self.has_alpha else "rgb24", **options)
        deep = frame.to_ndarray(format="rgba64le" if self.has_alpha else "rgb48le", **options)
        return np.concatenate([eight_bit(deep[:, :, :3], self._transfer), eight_bit(deep[:, :, 3:], "srgb")], axis=2)

    def _open(self) -> None:
        import av

        self.close()
        if not self.path.is_file():
            raise StudioError("footage.video_missing", "video not found", file=self.path)
        try:
            container = open_media(self.path)
        except (av.error.FFmpegError, OSError, ValueError):
            problem = "cannot open the file: it is truncated or not a video"
            raise StudioError("footage.video_unreadable", problem, file=self.path, fix=_ENCODE_AGAIN) from None
        stream = video_stream(container)
        if stream is None:
            films = [each for each in container.streams.video if each.codec_context is None]
            container.close()
            if films:
                raise StudioError(
                    "footage.video_unreadable", "the video has a codec that FFmpeg does not know", file=self.path,
                    fix=_ENCODE_AGAIN,
                )  # fmt: skip
            raise StudioError("footage.no_video_stream", "the file has no video stream", file=self.path)
        self._container, self._stream = container, stream
        self._frames = decoded(container, stream)
        self._next = 0

    def _without_empty(self, sizes: list[int], times: list[int]) -> None:
        """Find packets, by size in bytes and time, that repeat the frame before them, as written by MPEG-4 encoders for
        dropped frames: decoders return nothing for them, so the video would seem to be truncated."""
        import av

        if not times and self._container.format.name != "avi":  # others have no such packets
            return
        if not sizes or min(sizes) > _EMPTY_PACKET or sorted(sizes)[len(sizes) // 2] <= 8 * _EMPTY_PACKET:
            return
        try:
            with open_media(self.path) as container:
                stream = video_stream(container)
                assert stream is not None
                frames = [(frame.pts, frame.key_frame) for frame in decoded(container, stream)]
        except (av.error.FFmpegError, OSError):
            return  # reported when the frame is read
        stamps = [time for time, _ in frames if time is not None]
        if len(stamps) < len(frames) or stamps != sorted(stamps) or not times:
            self._repeat(sizes, len(frames))
            return
        silent = {time for time, size in zip(times, sizes, strict=True) if size <= _EMPTY_PACKET}
        missing = set(times) - set(stamps)
        if not missing or not missing <= silent or len(set(stamps)) != len(frames):
            return
        self._timestamps, self._coded_count = stamps, len(stamps)
        self._keyframes = [index for index, (_, key) in enumerate(frames) if key]
        self._shown = [max(0, bisect.bisect_right(stamps, time) - 1) for time in sorted(times)]
        self.note = f"{len(missing)} dropped frames repeat the ones before them"

    def _repeat(self, sizes: list[int], decoded_count: int) -> None:
        """Show the frames of a file without usable times again where its smallest packets are, by their sizes."""
        missing = len(sizes) - decoded_count
        smallest = sorted(sizes)[:missing]
        if not 0 < missing < len(sizes) or smallest[-1] > _EMPTY_PACKET:
            return
        has_image = np.ones(len(sizes), int)
        has_image[np.flatnonzero(np.array(sizes) <= smallest[-1])[:missing]] = 0
        self._shown = np.clip(np.cumsum(has_image) - 1, 0, decoded_count - 1).tolist()
        self._coded_count, self._timestamps, self._seekable = decoded_count, [], False
        self.note = f"{missing} packets without an image repeat the frames before them"

    def _at_constant_rate(self, times: list[int] | None) -> None:
        """Fill gaps in the presentation times. `times`: the times that the container lists; None: `_scan` has found
        them."""
        if times is not None:
            if _clock(times) is None and self._measured(times) is None:
                return
            self._scan(listed=True)
        clock = _clock(self._timestamps or ())
        if clock is None:
            self.fps = self._measured(self._timestamps or ()) or self.fps
            return
        interval, shown = clock
        rate = 1 / (interval * float(self._stream.time_base))
        if shown is None:
            self.close()
            problem = f"the frame rate varies too much to be made constant (usually {rate:.4g} fps)"
            fix = f"Convert the video: ffmpeg -i {self.path.name} -fps_mode cfr -r {rate:.4g} OUTPUT."
            raise StudioError("footage.variable_rate", problem, file=self.path, value=rate, fix=fix)
        self._shown, self.fps, self.frame_count = shown, rate, len(shown)
        used = len(set(shown))
        self.note = (
            f"the frame rate is not constant; at {rate:.4g} fps, {self.frame_count - used} frames repeat the ones "
            "before them"
        ) + (f", and {self._coded_count - used} are left out" if used < self._coded_count else "")

    def _measured(self, times: Sequence[int]) -> float | None:
        """The rate of sorted times; None if it is the one that the file says, or cannot be known."""
        if len(times) < 3 or times[-1] <= times[0]:
            return None
        rate = (len(times) - 1) / ((times[-1] - times[0]) * float(self._stream.time_base))
        differs = self.fps is None or abs(self.fps / rate - 1) * len(times) > _DRIFT
        return rate if differs else None

    def _scan(self, listed: bool = False) -> int:
        """Read the presentation times of all packets, or those `listed`, without decoding; returns the frame count."""
        import av

        times: list[int] = []
        keys: list[int] = []
        self._sizes: list[int] = []
        known = True
        try:
            with open_packets(self.path) if listed else open_media(self.path) as container:
                stream = container.streams[self._stream.index]
                for packet in container.demux(stream):
                    if packet.size == 0 or packet.is_discard:
                        continue
                    self._sizes.append(packet.size)
                    if packet.pts is None:
                        known = False
                        times.append(len(times))
                        continue
                    times.append(packet.pts)
                    if packet.is_keyframe:
                        keys.append(packet.pts)
        except (av.error.FFmpegError, OSError) as error:
            problem = f"cannot read the video ({error})"
            raise StudioError("footage.video_unreadable", problem, file=self.path, fix=_ENCODE_AGAIN) from None
        if not known or len(set(times)) != len(times):
            self._seekable = False  # no usable timestamps (raw streams, some AVI): count frames from the start
            self._timestamps = []
            return len(times)
        times.sort()
        self._timestamps = times
        self._keyframes = sorted(bisect.bisect_left(times, key) for key in keys)
        return len(times)

    def _decode(self, index: int) -> Any:
        """The decoded frame `index`, seeking only if it is faster than decoding forward."""
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
        if self._timestamps is None:  # the container lists all packets, else `__init__` would know them
            self._scan(listed=True)
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
                "footage.video_truncated",
                f"the video ends after {at} of {self._coded_count} frames",
                file=self.path,
                value=at,
                fix=f"Copy it again, or set capture.frames to :{at}.",
                frame=at,
                expected=self._coded_count,
                setting="capture.frames",
            ) from None
        except (av.error.FFmpegError, OSError, ValueError) as error:
            self.close()
            reason = getattr(error, "strerror", None) or error
            problem = f"cannot decode frame {at} ({reason})"
            raise StudioError(
                "footage.frame_undecodable", problem, file=self.path, fix=_ENCODE_AGAIN, frame=at
            ) from None
        if frame.is_corrupt:
            self.close()
            problem = f"frame {at} is damaged"
            raise StudioError("footage.frame_undecodable", problem, file=self.path, fix=_ENCODE_AGAIN, frame=at)
        self._next = at + 1
        return at, frame

    def _seek(self, index: int) -> None:
        """Seek to the last keyframe at or before `index`."""
        import av

        if self._timestamps is None:
            self._scan(listed=True)
        place = bisect.bisect_right(self._keyframes, index) - 1 if self._seekable else -1
        if place <= 0:
            self._open()
            return
        assert self._timestamps is not None
        start = self._keyframes[place]
        try:
            self._container.seek(self._timestamps[start], stream=self._stream, backward=True, any_frame=False)
            self._frames = decoded(self._container, self._stream)
            # In an open GOP, undecodable frames that precede the keyframe may come first: skip them.
            for frame in self._frames:
                if frame.pts is None or frame.pts > self._timestamps[start]:
                    break
                if frame.pts < self._timestamps[start]:
                    continue
                self._frames = itertools.chain([frame], self._frames)
                self._next = start
                self._current = None
                return
        except (av.error.FFmpegError, OSError, ValueError):
            pass
        self._open()  # unusable seek index: decoding from the start is slow but exact


def _clock(times: Sequence[int]) -> tuple[float, list[int] | None] | None:
    """The interval of frames at a constant rate and, for each, the index of the file's frame to show, by the sorted
    times of a video that skips frames or changes its rate; None if it nearly keeps one. There are no indices if
    there would be more than twice as many frames: the rate is not nearly constant.

    Phones and capture programs write no packet where a frame was dropped, and film fewer frames per second in low
    light. Counting packets would shift all later frames against the other cameras; here, the frame before a gap is
    shown again instead.
    """
    if len(times) < 3:
        return None
    mean = (times[-1] - times[0]) / (len(times) - 1)
    if max(abs(time - times[0] - index * mean) for index, time in enumerate(times)) <= _JITTER * mean:
        return None
    interval = interval_of(times, step=1)
    if interval is None:
        return None
    if max(abs(time - times[0] - index * interval) for index, time in enumerate(times)) <= _GAP * interval:
        return None
    count = round((times[-1] - times[0]) / interval) + 1
    if count > 2 * len(times):
        return interval, None
    ends = [times[0] + (index + 0.5) * interval for index in range(count)]
    return interval, [max(0, bisect.bisect_right(times, end) - 1) for end in ends]


def _display(frame: Any) -> tuple[int, bool]:
    """Counterclockwise quarter turns of a frame for display, after it is mirrored left to right if the second value is
    True. The side data are FFmpeg's display matrix: two columns of the map from stored to shown x and y, down."""
    sides = [data for data in frame.side_data if data.type.name == "DISPLAYMATRIX"]
    if not sides:
        return 0, False
    a, b, _, c, d = np.frombuffer(bytes(sides[0]), np.int32)[:5].astype(float)
    mirrored = bool(a * d < b * c)
    a, b = (-a, -b) if mirrored else (a, b)
    return round(float(-np.degrees(np.arctan2(b, a)) / 90)) % 4, mirrored


def _unusual(container: Any, stream: Any, frame: Any) -> Iterator[str]:
    """Clauses on properties of a video that a viewer would not see, but that change a reconstruction."""
    if len(container.streams.video) > 1:
        which = f"number {stream.index} ({frame.width}x{frame.height}, {stream.codec_context.name})"
        yield f"of {len(container.streams.video)} video streams, {which} is used"
    if frame.interlaced_frame:
        yield "the video is interlaced, and its lines of two times stay mixed"
    shape = float(stream.sample_aspect_ratio or 1)
    width, height = _with_square_pixels(frame.width, frame.height, shape)
    if (width, height) != (frame.width, frame.height):
        yield f"pixels are {shape:.4g} times as wide as high: stretched from {frame.width}x{frame.height}"
    if int(frame.color_trc) in _HDR:
        yield f"the video is HDR ({_HDR[int(frame.color_trc)]}), and its values are read as sRGB"
    elif int(frame.color_primaries) in _WIDE:
        yield f"the video has the primaries of {_WIDE[int(frame.color_primaries)]}, and its values are read as sRGB"


def _with_square_pixels(width: int, height: int, shape: float | Fraction | None) -> tuple[int, int]:
    """Size of an anamorphic image with square pixels (`shape`: width by height of one), if it is 1% off."""
    ratio = float(shape or 1)
    if abs(ratio - 1) < _SQUARE:
        return width, height
    return (round(width * ratio), height) if ratio > 1 else (width, round(height / ratio))
