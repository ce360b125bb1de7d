"""Transfer functions: what the numbers of an image file mean, and how they become what training compares.

Training, players and metrics work on sRGB values, as screens show them. Footage that was stored otherwise is decoded to
scene-linear light, limited to 0..1 (white of a diffuse reflector is about 0.9), and encoded as sRGB. Primaries are not
converted.
"""

import functools
from typing import Literal

import numpy as np

TransferFunction = Literal["auto", "srgb", "linear", "slog3", "logc3"]


def linear_from_slog3(codes: np.ndarray) -> np.ndarray:
    """Linear light, 0.18 is middle gray, from Sony S-Log3 in 0..1 (Technical Summary for S-Log3)."""
    codes = np.asarray(codes, np.float64) * 1023
    bright = 10 ** ((codes - 420) / 261.5) * (0.18 + 0.01) - 0.01
    return np.where(codes >= 171.2102946929, bright, (codes - 95) * 0.01125 / (171.2102946929 - 95))


def linear_from_logc3(codes: np.ndarray) -> np.ndarray:
    """Linear light, 0.18 is middle gray, from ARRI LogC3 in 0..1 at EI 800 (ALEXA Log C Curve in VFX)."""
    cut, a, b, c, d, e, f = 0.010591, 5.555556, 0.052272, 0.247190, 0.385537, 5.367655, 0.092809
    codes = np.asarray(codes, np.float64)
    return np.where(codes > e * cut + f, (10 ** ((codes - d) / c) - b) / a, (codes - f) / e)


def srgb_from_linear(light: np.ndarray) -> np.ndarray:
    """sRGB values 0..1 from linear light (IEC 61966-2-1), limited to 0..1 first; NaN is black; float64."""
    light = np.clip(np.nan_to_num(np.asarray(light, np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def eight_bit(values: np.ndarray, transfer: TransferFunction) -> np.ndarray:
    """sRGB in 8 bits from floats (linear: may exceed 1) or uint16 of the full range; auto is as srgb."""
    if values.dtype == np.uint16:
        converted: np.ndarray = _table(transfer)[values]
        return converted
    if transfer in ("auto", "srgb"):
        shown = np.clip(np.nan_to_num(values.astype(np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    elif transfer == "linear":
        shown = srgb_from_linear(values)
    else:
        shown = srgb_from_linear((linear_from_slog3 if transfer == "slog3" else linear_from_logc3)(values))
    return np.rint(255 * shown).astype(np.uint8)


@functools.cache
def _table(transfer: TransferFunction) -> np.ndarray:
    return eight_bit(np.arange(65536) / 65535.0, transfer)
