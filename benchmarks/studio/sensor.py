"""Turns rendered light into a camera's files: exposure, color, noise, chroma subsampling and compression."""

import zlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from rig import Camera


def developed(light: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W, 3) in [0, 1], sRGB, from linear light: exposure, white balance and a shoulder that keeps highlights."""
    exposed = np.maximum(light, 0) * 2.0**camera.exposure * np.array(camera.white)
    knee = 0.7
    rolled = np.where(exposed < knee, exposed, 1 - (1 - knee) * np.exp(-(exposed - knee) / (1 - knee)))
    return np.where(rolled <= 0.0031308, 12.92 * rolled, 1.055 * np.maximum(rolled, 1e-9) ** (1 / 2.4) - 0.055)


def recorded(image: np.ndarray, camera: Camera, frame: int) -> np.ndarray:
    """(H, W, 3) uint8 with the sensor's noise, whose seed is the camera's name and the frame."""
    random = np.random.default_rng([zlib.crc32(camera.name.encode()), frame])
    return to_bytes(image + random.normal(0, camera.noise, image.shape))


def to_bytes(image: np.ndarray) -> np.ndarray:
    """uint8 of values in [0, 1]."""
    return np.clip(np.rint(image * 255), 0, 255).astype(np.uint8)


def write_video(path: Path, images: Iterator[np.ndarray], fps: float, crf: int) -> None:
    """H.264 with 4:2:0 chroma, BT.709, from (H, W, 3) uint8 images."""
    options = {"crf": str(crf), "preset": "slow", "x264-params": "threads=1"}
    _encode(path, images, fps, "libx264", "yuv420p", options)


def write_matte(path: Path, masks: Iterator[np.ndarray], fps: float) -> None:
    """FFV1, lossless gray, from (H, W) uint8 masks."""
    _encode(path, masks, fps, "ffv1", "gray", {})


def _encode(
    path: Path, images: Iterator[np.ndarray], fps: float, codec: str, layout: str, options: dict[str, str]
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}")
    with av.open(str(partial), "w", format="matroska" if path.suffix == ".mkv" else "mp4") as file:
        stream = None
        for image in images:
            gray = image.ndim == 2
            if stream is None:
                stream = file.add_stream(codec, rate=Fraction(fps).limit_denominator(1001), options=options)
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = layout
                if not gray:
                    stream.codec_context.color_range, stream.codec_context.colorspace = 1, 1  # limited, BT.709
                    stream.codec_context.color_primaries, stream.codec_context.color_trc = 1, 1
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray" if gray else "rgb24")
            if not gray:
                frame = frame.reformat(format=layout, dst_colorspace=1, dst_color_range=1)
                frame.color_primaries, frame.color_trc = 1, 1
            file.mux(stream.encode(frame))
        if stream is not None:
            file.mux(stream.encode(None))
    partial.rename(path)
