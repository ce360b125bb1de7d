"""Images of more than 8 bits per channel: OpenEXR and DPX, decoded with FFmpeg; TIFF and PNG, with OpenCV."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from studio.capture.transfer import TransferFunction, eight_bit
from studio.errors import StudioError
from studio.storage import cached_object

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

_CODECS = {".exr": "exr", ".dpx": "dpx"}
_BY_OPENCV = (".tif", ".tiff", ".png")
_FIX = "Replace the file or exclude the frame."


def is_deep(path: Path, transfer: TransferFunction = "auto") -> bool:
    """Whether the file must be read with `read_deep_image`: its format, or a transfer function that needs all bits."""
    suffix = path.suffix.lower()
    return suffix in _CODECS or (suffix in _BY_OPENCV and transfer not in ("auto", "srgb"))


def read_deep_image(path: Path, transfer: TransferFunction) -> np.ndarray:
    """Decode an EXR (RGB or gray, half or float), DPX (8 to 16 bits), TIFF or PNG file to (H, W, 3) RGB or (H, W, 4)
    RGBA with straight alpha, uint8 sRGB; `transfer` auto: EXR files are linear, others sRGB."""
    values = read_deep_values(path)
    if values.dtype != np.uint16 or transfer not in ("auto", "srgb"):
        white = {"uint8": 255, "uint16": 65535}.get(values.dtype.name, 1)
        values = np.asarray(values, np.float32) / np.float32(white)
    if values.ndim == 2:
        values = np.repeat(values[:, :, None], 3, axis=2)
    color, alpha = values[:, :, :3], values[:, :, 3:]
    if path.suffix.lower() == ".exr":
        transfer = "linear" if transfer == "auto" else transfer
        if alpha.size:  # colors of EXR files are premultiplied
            color = color / np.maximum(alpha, 1e-6)
    return np.ascontiguousarray(np.concatenate([eight_bit(color, transfer), eight_bit(alpha, "srgb")], axis=2))


def read_deep_values(path: Path) -> np.ndarray:
    """The numbers in an EXR, DPX, TIFF or PNG file, (H, W) or (H, W, 3 or 4; RGB or RGBA): of DPX files 0 to 1, of
    others of the type in the file."""
    suffix = path.suffix.lower()
    data = _data(path)
    return _decoded(path, data, _CODECS[suffix]) if suffix in _CODECS else _opencv_values(path, data)


def _data(path: Path) -> bytes:
    try:
        stored = cached_object(path)
        return path.read_bytes() if stored is None else stored.read()
    except FileNotFoundError:
        raise StudioError("footage.image_missing", "image not found", file=path) from None
    except OSError as error:
        _refuse(path, str(error.strerror))


def _decoded(path: Path, data: bytes, name: str) -> np.ndarray:
    import av
    from av.codec import CodecContext
    from PIL.Image import MAX_IMAGE_PIXELS

    try:
        decoder: Any = CodecContext.create(name, "r")
        decoder.options = {"max_pixels": str(2 * (MAX_IMAGE_PIXELS or 0))}
        decoder.thread_count = 1
        frames = [*decoder.decode(av.Packet(data)), *decoder.decode(None)]
    except (av.error.FFmpegError, OSError, ValueError, MemoryError):
        frames = []
    if not frames or frames[0].is_corrupt:
        _refuse(path, f"damaged or truncated, or a kind of {name.upper()} that FFmpeg cannot read")
    return _channels(path, frames[0])


def _channels(path: Path, frame: VideoFrame) -> np.ndarray:
    """(H, W) or (H, W, 3 or 4) float32, 0..1 for integers."""
    kind = frame.format.name
    if "f32" in kind or "f16" in kind:
        number = np.dtype(np.float32 if "f32" in kind else np.float16).newbyteorder("<" if kind.endswith("le") else ">")
        planes = [
            np.frombuffer(bytes(plane), number).reshape(plane.height, -1)[:, : plane.width].astype(np.float32)
            for plane in frame.planes
        ]
        if len(planes) == 1:
            return planes[0]
        green, blue, red, *alpha = planes
        return np.stack([red, green, blue, *alpha], -1)
    bits = frame.format.components[0].bits
    if frame.format.is_rgb and kind.startswith("abgr"):
        values = frame.to_ndarray(format="rgba")
    elif frame.format.is_rgb or kind.startswith("gray"):
        values = frame.to_ndarray()
    else:
        _refuse(path, f"its pixel format, {kind}, is not supported")
    return values.astype(np.float32) / np.float32(2**bits - 1)


def _opencv_values(path: Path, data: bytes) -> np.ndarray:
    """(H, W) or (H, W, 3 or 4; RGB or RGBA), as stored."""
    import cv2

    try:
        values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        values = None
    if values is None or (values.ndim == 3 and values.shape[2] not in (3, 4)):
        _refuse(path, "not an image, damaged, or of a kind that OpenCV cannot read")
    if values.ndim == 3:
        values = values[:, :, [2, 1, 0, 3][: values.shape[2]]]
    return np.asarray(values)


def _refuse(path: Path, problem: str) -> NoReturn:
    raise StudioError("footage.image_unreadable", f"cannot read the image ({problem})", file=path, fix=_FIX) from None
