"""SPZ, Niantic's compressed splat format: writes version 3, reads versions 2 and 3, plain or gzipped.

Source: README and source code of github.com/nianticlabs/spz. A 16-byte header is followed by one attribute after the
other, all gzipped: positions (24-bit fixed point), opacities (8 bits), colors (8 bits over a wider range than 0 to 1),
log scales (8 bits, steps of 1/16), rotations (version 2: x y z in 8 bits each; version 3: the smallest three components
in 10 bits each) and SH (8 bits, of which degree 1 uses 5 and higher degrees use 4).
"""

from __future__ import annotations

import gzip
import math
import struct
import zlib
from pathlib import Path

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.splat_files.checks import MAX_SPLATS, from_arrays, to_arrays

_HEAD = struct.Struct("<IIIBBBB")  # magic, version, splats, SH degree, fractional bits, flags, reserved
_MAGIC = 0x5053474E  # "NGSP"
_WRITTEN_VERSION = 3
_EXTENSIONS = 0x2  # flag: vendor extensions between header and positions
_LARGEST = (1 << 23) - 1  # largest integer of a position
_FRACTION_BITS = (12, 20)  # range of fractional bits; the reference implementation writes 12
_COLOR_SCALE = 0.15
_SH_BITS = (5, 4)  # degree 1, higher degrees
_SMALLEST = 511  # 9 bits for a quaternion component of at most sqrt(1/2)


def write_spz(path: Path, gaussians: Gaussians) -> None:
    """Write an SPZ file of version 3. The same splats give the same bytes.

    Positions have at least 12 fractional bits and at least 16 bits over the extent of the splats, if that fits.

    Raises:
        StudioError: there are no splats, a value is not finite, or a position is too far from the origin for 24 bits.
    """
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
    parts = [
        _HEAD.pack(_MAGIC, _WRITTEN_VERSION, len(means), gaussians.sh_degree, bits, 0, 0),
        fixed.view(np.uint8).reshape(-1, 3, 4)[:, :, :3].tobytes(),
        _byte(opacities * 255),
        _byte(sh[:, 0] * (_COLOR_SCALE * 255) + 127.5),
        _byte((arrays["log_scales"] + 10) * 16),
        _pack_quats(arrays["quats"]).astype("<u4").tobytes(),
        _byte_buckets(sh[:, 1:4], _SH_BITS[0], sh[:, 4:], _SH_BITS[1]),
    ]
    path.write_bytes(gzip.compress(b"".join(parts), mtime=0))


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
    """Number of splats and SH degree. Raises StudioError as `read_spz`."""
    count, degree, _, _, _ = _read_head(path)
    return count, degree


def _read_head(path: Path) -> tuple[int, int, int, int, bytes]:
    """Splat count, SH degree, version, fractional bits; and the bytes after the header, up to the declared size."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise StudioError("splat_file.not_found", "no such file", file=path) from None
    except OSError as error:
        raise StudioError("splat_file.unreadable", f"cannot be read ({error.strerror})", file=path) from None
    if data[:2] == b"\x1f\x8b":
        inflater = zlib.decompressobj(wbits=31)
        try:
            head = inflater.decompress(data, _HEAD.size)
            count, degree, version, bits = _checked_head(path, head)
            size = _body_size(count, degree, version)
            body = inflater.decompress(inflater.unconsumed_tail, size + 1)
        except zlib.error as error:
            raise StudioError(
                "splat_file.unreadable",
                f"the SPZ file is damaged ({error})",
                file=path,
                fix="Export or copy it again.",
            ) from None
    else:
        count, degree, version, bits = _checked_head(path, data[: _HEAD.size])
        size, body = _body_size(count, degree, version), data[_HEAD.size :]
    if len(body) < size:
        raise StudioError(
            "splat_file.truncated",
            f"the SPZ file ends after {len(body)} of {size} bytes",
            file=path,
            value=len(body),
            fix="Export or copy it again.",
            expected=size,
        )
    return count, degree, version, bits, body[:size]


def _checked_head(path: Path, head: bytes) -> tuple[int, int, int, int]:
    if len(head) < _HEAD.size or head[:4] != _MAGIC.to_bytes(4, "little"):
        raise StudioError("splat_file.unreadable", "not an SPZ file", file=path, fix="Export or copy it again.")
    _, version, count, degree, bits, flags, _ = _HEAD.unpack(head)
    if version not in (2, 3):
        raise StudioError(
            "splat_file.unsupported_version",
            f"the SPZ version is {version}; only versions 2 and 3 are supported",
            file=path,
            value=version,
            fix="Convert it, for example to PLY.",
        )
    if not 0 < count <= MAX_SPLATS or degree > 3 or bits > 23:
        raise StudioError(
            "splat_file.invalid_header",
            f"{count} splats of SH degree {degree} with {bits} fractional bits; expected 1 to {MAX_SPLATS} splats, "
            "degree 0 to 3 and 0 to 23 bits",
            file=path,
            value=(count, degree, bits),
        )
    if flags & _EXTENSIONS:
        raise StudioError(
            "splat_file.extensions",
            "SPZ extensions are not supported",
            file=path,
            fix="Export the file without them.",
        )
    return count, degree, version, bits


def _body_size(count: int, degree: int, version: int) -> int:
    return count * (9 + 1 + 3 + 3 + (4 if version == 3 else 3) + 3 * ((degree + 1) ** 2 - 1))


def read_spz(path: Path) -> Gaussians:
    """Read an SPZ file of version 2 or 3.

    Raises:
        StudioError: the file is missing, damaged, not an SPZ file, of an unsupported version, or has extensions.
    """
    count, degree, version, bits, body = _read_head(path)
    values = np.frombuffer(body, np.uint8)
    position = 0

    def take(columns: int) -> np.ndarray:
        nonlocal position
        part = values[position : position + count * columns].reshape(count, columns)
        position += count * columns
        return part

    packed = take(9).reshape(count, 3, 3).astype(np.int32)
    fixed = packed[..., 0] | packed[..., 1] << 8 | packed[..., 2] << 16
    means = np.where(fixed & 0x800000, fixed - (1 << 24), fixed) / (1 << bits)
    opacities = take(1)[:, 0] / 255
    colors = (take(3) / 255 - 0.5) / _COLOR_SCALE
    log_scales = take(3) / 16 - 10
    if version == 3:
        quats = _unpack_quats(take(4).copy().view("<u4")[:, 0])
    else:
        xyz = take(3) / 127.5 - 1
        quats = np.column_stack([np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1))), xyz])
    rest = (degree + 1) ** 2 - 1
    sh = np.concatenate([colors[:, None], (take(3 * rest).reshape(count, rest, 3) - 128.0) / 128], axis=1)
    with np.errstate(divide="ignore"):
        logits = np.log(opacities) - np.log1p(-opacities)
    arrays = {"means": means, "quats": quats, "log_scales": log_scales, "logit_opacities": logits, "sh": sh}
    return from_arrays(path, arrays)
