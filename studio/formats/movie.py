"""Renders a splat video from a moving camera to a widely supported MP4, with sound if it plays at its own speed."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import torch

from v3studio.studio.audio import Pcm
from v3studio.studio.audio.encode import SoundEncoder
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.placing import new_file
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer import preferred_device, rasterize
from v3studio.studio.splat_video import SplatVideo

_BT709 = 1  # FFmpeg's number for the BT.709 matrix, primaries and transfer, which players assume for HD video
_MPEG_RANGE = 1
MAX_SIDE = 16384
_STEADY = 0.5  # frames by which a movie's frame may differ from that of steady playback


def render_movie(
    video: SplatVideo,
    path: Path,
    camera: Callable[[float], Camera],
    frame: Callable[[float], float],
    seconds: float,
    fps: float,
    crf: int = 18,
    progress: ProgressFn = no_progress,
) -> int:
    """Render and encode a movie; returns the number of images. The file appears only when it is complete.

    It has the video's sound if it shows the frames at their own speed, see `movie_sound`.

    Args:
        path: .mp4 file; must not exist.
        camera: returns the camera at a time in seconds; all cameras must have the same, even size.
        frame: returns the frame of the video at a time in seconds; rounded down, modulo the number of frames.
        seconds, fps: duration in seconds, above 0 and at most 86,400, and frame rate, above 0 and at most 240.
        crf: constant rate factor of x264, 0 (best) to 51.
    """
    if path.suffix.lower() != ".mp4":
        problem = "movies are written as .mp4"
        fix = "Use the extension .mp4."
        raise StudioError("export.unsupported_format", problem, file=path, value=path.suffix, fix=fix)
    for name, value, valid, expected in (
        ("fps", fps, 0 < fps <= 240, "above 0 and at most 240"),
        ("seconds", seconds, 0 < seconds <= 86_400, "above 0 and at most 86,400"),
        ("crf", crf, 0 <= crf <= 51, "0 to 51"),
    ):
        if not valid:
            problem = f"{name} is {value:g}; it must be {expected}"
            raise StudioError("export.invalid_setting", problem, file=path, value=value, name=name)
    first = camera(0.0)
    if first.width % 2 or first.height % 2 or max(first.width, first.height) > MAX_SIDE:
        problem = f"the size is {first.width}x{first.height}; H.264 requires even numbers up to {MAX_SIDE}"
        raise StudioError("export.invalid_size", problem, file=path, value=(first.width, first.height))
    count = max(1, round(seconds * fps))
    device = preferred_device()
    background = torch.tensor(video.background, dtype=torch.float32, device=device)
    shown, gaussians, behind = -1, None, video.behind()
    sound, _ = movie_sound(video, frame, seconds, fps)
    with new_file(path) as temporary, _encoder(temporary, first.width, first.height, fps, crf, sound) as add:
        for index in range(count):
            progress(index, count)
            time = index / fps
            wanted = int(np.floor(frame(time) + 1e-6)) % video.frame_count
            if gaussians is None or wanted != shown:
                shown, gaussians = wanted, video.read(wanted).before(behind).to(device)
            with torch.no_grad():
                image = rasterize(gaussians, camera(time), background).image
            add((image.clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy())
        progress(count, count)
    return count


@contextmanager
def _encoder(
    path: Path, width: int, height: int, fps: float, crf: int, sound: MovieSound | None
) -> Iterator[Callable[[np.ndarray], None]]:
    """A function that encodes the next image, (H, W, 3) uint8 RGB, as H.264, BT.709, limited range, with its sound."""
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as out:
        rate = Fraction(fps).limit_denominator(1001)
        stream = out.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        context.color_range = _MPEG_RANGE
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.options = {"crf": str(crf), "preset": "medium"}
        audio = None if sound is None else SoundEncoder(out, sound.sample_rate, sound.channels)
        pictures = itertools.count(1)

        def add(picture: np.ndarray) -> None:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709", src_color_range="JPEG", dst_color_range="MPEG"
            )
            frame.pts = None
            for packet in stream.encode(frame):
                out.mux(packet)
            if sound is not None and audio is not None:
                audio.add(sound.until(next(pictures) / rate))

        yield add
        for packet in stream.encode():
            out.mux(packet)
        if audio is not None:
            audio.close()


class MovieSound:
    """Sound by movie time, from `start` seconds on; it starts over after each `duration` of the video."""

    def __init__(self, sound: Pcm, start: float, duration: float) -> None:
        self.sample_rate = sound.sample_rate
        self.channels = sound.channels
        self._sound = sound
        self._start = start
        self._duration = duration
        self._done = 0

    def until(self, time: Fraction | float) -> np.ndarray:
        """The samples from where the last call ended up to a movie time in seconds, (n, channels) float32."""
        end = round(time * self.sample_rate)
        out = np.zeros((max(end - self._done, 0), self.channels), np.float32)
        filled = 0
        while filled < len(out):
            at = (self._start + (self._done + filled) / self.sample_rate) % self._duration
            left = max(round((self._duration - at) * self.sample_rate), 1)
            count = min(left, len(out) - filled)
            out[filled : filled + count] = self._sound.read(round(at * self.sample_rate), count)
            filled += count
        self._done = max(end, self._done)
        return out


def movie_sound(
    video: SplatVideo, frame: Callable[[float], float], seconds: float, fps: float
) -> tuple[MovieSound | None, str]:
    """The sound of a movie of `video` and "", None and "" for a silent video, or None and the reason if it is left out
    because the movie does not show the frames at their own speed; `frame` as for `render_movie`."""
    if video.sound is None:
        return None, ""
    times = np.arange(max(1, round(seconds * fps))) / fps
    shown = np.array([frame(float(time)) for time in times])
    away = shown - (shown[0] + times * video.fps)
    away -= np.round(away / video.frame_count) * video.frame_count  # loops
    if np.abs(away).max() > _STEADY:
        return None, "the movie does not show the frames at their own speed"
    return MovieSound(video.sound, shown[0] / video.fps, video.duration), ""
