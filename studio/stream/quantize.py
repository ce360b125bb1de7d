"""Uniform quantization over a range, and the two bytes of 16-bit codes."""

import numpy as np

LEVELS_8 = 255
LEVELS_16 = 65535


def quantize(values: np.ndarray, low: float, high: float, levels: int) -> np.ndarray:
    """Round finite values of any shape to uint16 codes of `levels` + 1 (256 or 65536) equally spaced levels from `low`
    to `high`. Values outside are clamped; if the range is empty, all codes are 0."""
    if high <= low:
        return np.zeros(values.shape, dtype=np.uint16)
    scaled = (values.astype(np.float64) - low) * (levels / (high - low))
    return np.clip(np.rint(scaled), 0, levels).astype(np.uint16)


def dequantize(codes: np.ndarray, low: float, high: float, levels: int) -> np.ndarray:
    """Inverse of `quantize`: float32, low + code (high - low) / levels."""
    return codes.astype(np.float32) * np.float32((high - low) / levels) + np.float32(low)


def split_bytes(codes: np.ndarray, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
    """High and low byte of uint16 codes. A plain low byte jumps between 255 and 0 whenever the high byte changes: an
    edge in space and time that costs many bits and that a lossy codec blurs. Mirrored, it is 255 - low where the high
    byte is odd, and therefore continuous wherever the position is."""
    high = (codes >> 8).astype(np.uint8)
    low = (codes & 255).astype(np.uint8)
    if mirrored:
        low = np.where(high & 1, 255 - low, low).astype(np.uint8)
    return high, low


def join_bytes(high: np.ndarray, low: np.ndarray, mirrored: bool) -> np.ndarray:
    """Inverse of `split_bytes`: uint16 codes. Errors of the low byte do not propagate to the high byte."""
    if mirrored:
        low = np.where(high & 1, 255 - low, low)
    return (high.astype(np.uint16) << 8) | low
