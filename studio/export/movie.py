"""A Gaussian video drawn from moving cameras, as an MP4 that every player plays."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import torch

from studio.cameras import Camera
from studio.errors import StudioError
from studio.export.placing import new_file
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.rasterizer import preferred_device, rasterize
from studio.splat_video import SplatVideo

_BT709 = 1  # FFmpeg's number for BT.709 as matrix, primaries and transfer; what players take HD video for
_MPEG_RANGE = 1
MAX_SIDE = 16384


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
    """Draw and encode; the file appears when it is complete.

    Args:
        video: what is drawn, over its background.
        path: an .mp4 that does not exist.
        camera: the camera at a time in seconds; all of one, even size.
        frame: the frame of the video at a time; rounded down and taken round the video's end.
        seconds, fps: length and rate of the movie.
        crf: x264's quality, 0 (best) to 51.
        progress: called with pictures drawn, of all.

    Returns:
        Pictures drawn.

    Raises:
        StudioError: a frame cannot be read, settings out of range, or the file exists or cannot be written.
    """
    if path.suffix.lower() != ".mp4":
        raise StudioError(f"{path}: movies are written as .mp4; give such a name.")
    if not 0 < fps <= 240 or not 0 < seconds <= 86_400 or not 0 <= crf <= 51:
        raise StudioError(
            f"{path}: {seconds:g} s at {fps:g} frames a second with CRF {crf} asked for; up to 86,400 s, 240 frames a "
            "second and CRF 0 to 51 can be had."
        )
    first = camera(0.0)
    if first.width % 2 or first.height % 2 or max(first.width, first.height) > MAX_SIDE:
        raise StudioError(
            f"{path}: a size of {first.width}x{first.height} was asked for; H.264 needs even numbers, up to {MAX_SIDE}."
        )
    count = max(1, round(seconds * fps))
    device = preferred_device()
    background = torch.tensor(video.background, dtype=torch.float32, device=device)
    shown, gaussians = -1, None
    with new_file(path) as temporary, _Encoder(temporary, first.width, first.height, fps, crf) as encoder:
        for index in range(count):
            progress(index, count)
            time = index / fps
            wanted = int(np.floor(frame(time) + 1e-6)) % video.frame_count
            if gaussians is None or wanted != shown:
                shown, gaussians = wanted, video.read(wanted).to(device)
            encoder.add(_picture(gaussians, camera(time), background))
        progress(count, count)
    return count


def _picture(gaussians: Gaussians, camera: Camera, background: torch.Tensor) -> np.ndarray:
    with torch.no_grad():
        image = rasterize(gaussians, camera, background).image
    return (image.clamp(0, 1) * 255 + 0.5).to(torch.uint8).cpu().numpy()


class _Encoder:
    """H.264 of 8-bit RGB pictures, BT.709, limited range. Use as a context manager."""

    def __init__(self, path: Path, width: int, height: int, fps: float, crf: int) -> None:
        import av

        self._av = av
        self._out = av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
        stream = self._out.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        context.color_range = _MPEG_RANGE
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.options = {"crf": str(crf), "preset": "medium"}
        self._stream = stream

    def add(self, picture: np.ndarray) -> None:
        """The next picture, (H, W, 3) uint8."""
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        frame = frame.reformat(
            format="yuv420p", dst_colorspace="ITU709", src_color_range="JPEG", dst_color_range="MPEG"
        )
        frame.pts = None
        for packet in self._stream.encode(frame):
            self._out.mux(packet)

    def __enter__(self) -> _Encoder:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            for packet in self._stream.encode():
                self._out.mux(packet)
        self._out.close()
