"""The chroma grid of a video: its subsampling, and where the decoder places the samples."""

from collections.abc import Callable
from typing import Any

import numpy as np

from v3studio.studio.chroma import ChromaSampling

_MATRIX_TAGS = {1: "bt709", 9: "bt2020", 10: "bt2020"}  # FFmpeg's AVColorSpace; BT.601 if untagged, as in `VideoReader`
_LEVELS = 4
"""Slope of the ramp per sample, of 8 bits: steep, as results are rounded to whole levels, but red must not clip."""


def chroma_grid(frame: Any, to_rgb: Callable[[Any], np.ndarray], color_matrix: str) -> ChromaSampling | None:
    """The chroma grid of a decoded `av.VideoFrame`, which is overwritten.

    FFmpeg places samples by the stream's tag, or by the codec's default, and PyAV tells neither. So a frame whose
    chroma is a ramp is converted by `to_rgb`, to (H, W, 3 or more) RGB uint8, and the place where the ramp crosses gray
    tells where its samples are. None for frames without subsampled chroma, frames whose chroma planes are interleaved
    (NV12), and frames with fewer than 8 chroma samples per row or column.
    """
    chroma = [index for index, part in enumerate(frame.format.components) if part.is_chroma]
    if len(chroma) != 2 or len(frame.planes) < 3:
        return None
    part = frame.format.components[chroma[1]]
    step = (-(-frame.width // part.width), -(-frame.height // part.height))
    if step == (1, 1) or min(part.width, part.height) < 8:
        return None
    frame.make_writable()
    for plane, about in zip(frame.planes, frame.format.components, strict=False):
        _fill(plane, np.full((plane.height, plane.width), 1 << (about.bits - 1)), about.bits)
    first = []
    for axis, (size, samples) in enumerate(((part.width, step[0]), (part.height, step[1]))):
        ramp = _LEVELS * np.clip(np.arange(size) - size // 2, -_reach(size), _reach(size))
        levels = (1 << (part.bits - 1)) + np.left_shift(ramp, part.bits - 8)
        plane = frame.planes[chroma[1]]
        both = (part.height, part.width)
        _fill(plane, np.broadcast_to(levels if axis == 0 else levels[:, None], both), part.bits)
        red = to_rgb(frame)[..., 0].astype(np.float64)
        first.append(_first(red.mean(axis), size, samples))
    matrix = _MATRIX_TAGS.get(int(frame.colorspace), "bt601") if color_matrix == "auto" else color_matrix
    return ChromaSampling(step, (first[0], first[1]), "left" if first[0] < 0.25 else "center", matrix)


def _reach(size: int) -> int:
    return min(12, size // 2 - 1)


def _first(red: np.ndarray, size: int, step: int) -> float:
    """Position of the first sample, rounded to half pixels, from the ramp along an axis."""
    if step == 1:
        return 0.0
    gray = (red[0] + red[-1]) / 2  # the ramp ends equally far from gray on both sides
    middle, half = step * (size // 2), step * max(2, _reach(size) // 2)
    at = np.arange(middle - half, middle + half)
    slope, offset = np.polyfit(at, red[at] - gray, 1)
    return round(2 * (-offset / slope - middle)) / 2


def _fill(plane: Any, samples: np.ndarray, bits: int) -> None:
    """Write (height, width) levels into a plane of 8 bits or 9 to 16 bits per sample."""
    kind = np.dtype("u1") if bits == 8 else np.dtype("<u2")
    rows = np.zeros((plane.height, plane.line_size // kind.itemsize), kind)
    rows[:, : plane.width] = samples
    data = rows.tobytes()
    plane.update(data + bytes(plane.buffer_size - len(data)))
