"""SPZ, Niantic's compressed splat format: writes versions 3 and 4, reads versions 2 to 4.

Source: README and source code of github.com/nianticlabs/spz (MIT). Six attributes, one after the other: positions
(24-bit fixed point), opacities (8 bits), colors (8 bits over a wider range than 0 to 1), log scales (8 bits, steps of
1/16), rotations (version 2: x y z in 8 bits each; later: the smallest three components in 10 bits each) and SH (8 bits,
of which degree 1 uses 5 and higher degrees 4). `spz_container` has what is around them.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.splat_files.checks import from_arrays, logits, to_arrays
from studio.splat_files.spz_container import WRITTEN_VERSIONS, Head, read_container, read_head, write_container

DEFAULT_VERSION = 4
"""Which version is written: what other converters write by default."""

_LARGEST = (1 << 23) - 1  # largest integer of a position
_FRACTION_BITS = (12, 20)  # range of fractional bits; the reference implementation writes 12
_COLOR_SCALE = 0.15
_SH_BITS = (5, 4)  # degree 1, higher degrees
_SMALLEST = 511  # 9 bits for a quaternion component of at most sqrt(1/2)


def write_spz(path: Path, gaussians: Gaussians, version: int = DEFAULT_VERSION) -> None:
    """Write an SPZ file. The same splats give the same bytes.

    Positions have at least 12 fractional bits and at least 16 bits over the extent of the splats, if that fits.

    Args:
        path: file to write.
        gaussians: one frame.
        version: 4 (Zstandard), or 3 (gzip) for older viewers; both have the same splats.

    Raises:
        StudioError: the version is another one, there are no splats, a value is not finite, or a position is too far
            from the origin for 24 bits.
    """
    if version not in WRITTEN_VERSIONS:
        raise StudioError(
            "splat_file.unsupported_version",
            f"SPZ is written in versions 3 and 4, not {version}",
            file=path,
            value=version,
            fix="Choose 3 or 4.",
        )
    arrays = to_arrays(path, gaussians)
    means = arrays["means"].astype(np.float64)
    farthest, extent = float(np.abs(means).max()), float(np.ptp(means, axis=0).max())
    fits = _FRACTION_BITS[1] if farthest == 0 else math.floor(math.log2(_LARGEST / farthest))
    wanted = _FRACTION_BITS[0] if extent == 0 else math.ceil(math.log2(65536 / extent))
    bits = min(fits, max(_FRACTION_BITS[0], min(wanted, _FRACTION_BITS[1])))
    if bits < 0:
        raise StudioError(
            "splat_file.position_range",
            f"a splat is {farthest:g} units from the origin; SPZ supports up to {_LARGEST}",
            file=path,
            value=farthest,
        )
    fixed = np.rint(means * (1 << bits)).astype("<i4")
    sh = arrays["sh"]
    opacities = 1 / (1 + np.exp(-arrays["logit_opacities"].astype(np.float64)))
    attributes = [
        fixed.view(np.uint8).reshape(-1, 3, 4)[:, :, :3].tobytes(),
        _byte(opacities * 255),
        _byte(sh[:, 0] * (_COLOR_SCALE * 255) + 127.5),
        _byte((arrays["log_scales"] + 10) * 16),
        _pack_quats(arrays["quats"]).astype("<u4").tobytes(),
        _byte_buckets(sh[:, 1:4], _SH_BITS[0], sh[:, 4:], _SH_BITS[1]),
    ]
    write_container(path, Head(version, len(means), gaussians.sh_degree, bits), attributes)


def _byte(values: np.ndarray) -> bytes:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8).tobytes()


def _byte_buckets(first: np.ndarray, first_bits: int, others: np.ndarray, other_bits: int) -> bytes:
    """SH coefficients as bytes, rounded to bucket centers for better compression."""

    def rounded(values: np.ndarray, bits: int) -> np.ndarray:
        bucket = 1 << (8 - bits)
        codes = np.rint(values * 128).astype(np.int64) + 128
        return np.clip((codes + bucket // 2) // bucket * bucket, 0, 255).astype(np.uint8)

    return np.concatenate([rounded(first, first_bits), rounded(others, other_bits)], axis=1).tobytes()


def _pack_quats(wxyz: np.ndarray) -> np.ndarray:
    """(N,) uint32: index of the largest of x y z w in the upper 2 bits, then sign and 9 bits for each of the others."""
    xyzw = wxyz[:, [1, 2, 3, 0]].astype(np.float64)
    largest = np.abs(xyzw).argmax(axis=1)
    rows = np.arange(len(xyzw))
    xyzw *= np.where(xyzw[rows, largest] < 0, -1, 1)[:, None]
    packed = largest.astype(np.uint32)
    for component in range(4):
        value = xyzw[:, component]
        size = np.minimum(np.floor(np.abs(value) * (_SMALLEST * math.sqrt(2)) + 0.5), _SMALLEST).astype(np.uint32)
        code = (np.uint32(1) << np.uint32(9)) * (value < 0) + size
        packed = np.where(largest == component, packed, (packed << np.uint32(10)) | code).astype(np.uint32)
    return packed


def _unpack_quats(packed: np.ndarray) -> np.ndarray:
    """Inverse of `_pack_quats`: (N, 4) wxyz."""
    largest = packed >> np.uint32(30)
    rest = packed.copy()
    xyzw = np.zeros((len(packed), 4))
    for component in (3, 2, 1, 0):
        stored = largest != component
        size = (rest & np.uint32(511)) / (_SMALLEST * math.sqrt(2))
        xyzw[stored, component] = np.where(rest & np.uint32(512), -size, size)[stored]
        rest = np.where(stored, rest >> np.uint32(10), rest)
    rows = np.arange(len(packed))
    xyzw[rows, largest] = np.sqrt(np.maximum(0, 1 - (xyzw**2).sum(axis=1)))
    return xyzw[:, [3, 0, 1, 2]]


def spz_size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree from the header. Raises StudioError as `read_spz`, for the header."""
    head = read_head(path)
    return head.count, head.degree


def read_spz(path: Path) -> Gaussians:
    """Read an SPZ file of version 2, 3 or 4.

    Raises:
        StudioError: the file is missing, damaged, not an SPZ file, of an unsupported version, or has extensions that
            change the meaning of the values.
    """
    head, attributes = read_container(path)
    count = head.count
    positions, opacities, colors, scales, rotations, harmonics = (
        np.frombuffer(data, np.uint8).reshape(count, -1) for data in attributes
    )
    packed = positions.reshape(count, 3, 3).astype(np.int32)
    fixed = packed[..., 0] | packed[..., 1] << 8 | packed[..., 2] << 16
    means = np.where(fixed & 0x800000, fixed - (1 << 24), fixed) / (1 << head.bits)
    if head.version == 2:
        xyz = rotations / 127.5 - 1
        quats = np.column_stack([np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1))), xyz])
    else:
        quats = _unpack_quats(rotations.copy().view("<u4")[:, 0])
    rest = (head.degree + 1) ** 2 - 1
    sh = np.concatenate(
        [((colors / 255 - 0.5) / _COLOR_SCALE)[:, None], (harmonics.reshape(count, rest, 3) - 128.0) / 128], axis=1
    )
    arrays = {
        "means": means,
        "quats": quats,
        "log_scales": scales / 16 - 10,
        "logit_opacities": logits(opacities[:, 0] / 255),
        "sh": sh,
    }
    return from_arrays(path, arrays)
