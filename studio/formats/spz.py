"""SPZ, Niantic's compressed splat format: writes versions 3 and 4, reads versions 2 to 4.

Source: README, extensions/README.md and source code of github.com/nianticlabs/spz (MIT). Six attributes, one after the
other: positions (24-bit fixed point), opacities (8 bits), colors (8 bits over a wider range than 0 to 1), log scales
(8 bits, steps of 1/16), rotations (version 2: x y z in 8 bits each; later: the smallest three components in 10 bits
each) and SH (8 bits, of which degree 1 uses 5 and higher degrees 4).

The container: versions 2 and 3 are a 16-byte header and one attribute after the other, all of it gzipped (or plain).
Version 4 is a plain 32-byte header, extension records, a table of contents (compressed and uncompressed size of each
attribute, uint64) and one Zstandard frame per attribute; attributes without bytes are left out.
"""

import gzip
import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

from v3studio.studio.errors import StudioError
from v3studio.studio.formats import checks
from v3studio.studio.formats.rigid_motion import turned
from v3studio.studio.gaussians import Gaussians

DEFAULT_VERSION = 4  # which version is written: what other converters write by default

_LARGEST = (1 << 23) - 1  # largest integer of a position
_FRACTION_BITS = (12, 20)  # range of fractional bits; the reference implementation writes 12
_COLOR_SCALE = 0.15
_SH_BITS = (5, 4)  # degree 1, higher degrees
_SMALLEST = 511  # 9 bits for a quaternion component of at most sqrt(1/2)

VERSIONS = (2, 3, 4)
WRITTEN_VERSIONS = (3, 4)

_HEAD = struct.Struct("<IIIBBBB")  # magic, version, splats, SH degree, fractional bits, flags, streams (version 4)
_HEAD_4 = struct.Struct("<IIIBBBBI12x")  # the same and the offset of the table of contents
_ENTRY = struct.Struct("<QQ")
_RECORD = struct.Struct("<II")  # type and size of an extension
_MAGIC = 0x5053474E  # "NGSP"
_ZSTD_VERSION = 4
_ANTIALIASED, _EXTENSIONS = 0x1, 0x2  # flags
_SH_EXTENSION, _ORBIT_EXTENSION, _AXES_EXTENSION = 0xADBE0001, 0xADBE0002, 0xADBE0003
_MOST_RECORDS = 1 << 16  # bytes of extensions after the attributes of version 2 or 3
# Where x, y and z point, by the number in the record: left or right, up or down, front or back. 0: not known
_AXES = ("RUB", "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF",
         "LFD", "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU")  # fmt: skip
_DIRECTIONS = {"R": (1, 0, 0), "L": (-1, 0, 0), "U": (0, 1, 0), "D": (0, -1, 0), "B": (0, 0, 1), "F": (0, 0, -1)}
# Of 1 to 22. 31,900 trained splats: 1.5% fewer bytes than level 12, in 0.1 s; more does not help
_ZSTD_LEVEL = 19
_LARGEST_WINDOW = 1 << 27  # of Zstandard; what level 22 needs


def write(path: Path, gaussians: Gaussians, version: int = DEFAULT_VERSION, offset: np.ndarray | None = None) -> None:
    """Write an SPZ file of version 4 (Zstandard), or 3 (gzip) for older viewers; the same splats give the same bytes.

    Positions have at least 12 fractional bits and at least 16 bits over the extent of the splats, if that fits;
    `offset`, (3,) float64, is added to them.
    """
    if version not in WRITTEN_VERSIONS:
        problem = f"SPZ is written in versions 3 and 4, not {version}"
        raise StudioError("splat_file.unsupported_version", problem, file=path, value=version, fix="Choose 3 or 4.")
    arrays = checks.to_arrays(path, gaussians)
    means = arrays["means"] + (np.zeros(3) if offset is None else offset)
    farthest, extent = float(np.abs(means).max()), float(np.ptp(means, axis=0).max())
    fits = _FRACTION_BITS[1] if farthest == 0 else math.floor(math.log2(_LARGEST / farthest))
    wanted = _FRACTION_BITS[0] if extent == 0 else math.ceil(math.log2(65536 / extent))
    bits = min(fits, max(_FRACTION_BITS[0], min(wanted, _FRACTION_BITS[1])))
    if bits < 0:
        problem = f"a splat is {farthest:g} units from the origin; SPZ supports up to {_LARGEST}"
        raise StudioError("splat_file.position_range", problem, file=path, value=farthest, fix="Export as PLY.")
    if offset is not None and 0 < extent < 1000 * 2.0**-bits:
        problem = f"{farthest:g} units from the origin, where SPZ rounds to {2.0**-bits:g} units"
        fix = "Export with --axes viewer, which leaves them near the origin, or as PLY."
        raise StudioError("splat_file.position_range", problem, file=path, value=farthest, fix=fix)
    fixed = np.rint(means * (1 << bits)).astype("<i4")
    sh = arrays["sh"]
    opacities = 1 / (1 + np.exp(-arrays["logit_opacities"].astype(np.float64)))
    attributes = [
        fixed.view(np.uint8).reshape(-1, 3, 4)[:, :, :3].tobytes(),
        _byte(np.clip(opacities * 255, 1, 254)),  # of 0 and 255, readers take the logit, which is infinite
        _byte(sh[:, 0] * (_COLOR_SCALE * 255) + 127.5),
        _byte((arrays["log_scales"] + 10) * 16),
        _pack_quats(arrays["quats"]).astype("<u4").tobytes(),
        _byte_buckets(sh),
    ]
    write_container(path, Head(version, len(means), gaussians.sh_degree, bits), attributes)


def _byte(values: np.ndarray) -> bytes:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8).tobytes()


def _byte_buckets(sh: np.ndarray) -> bytes:
    """SH coefficients above degree 0 as bytes, rounded to bucket centers for better compression."""
    bits = np.where(np.arange(1, sh.shape[1]) < 4, *_SH_BITS)
    bucket = (1 << (8 - bits))[:, None]
    codes = np.rint(sh[:, 1:] * 128).astype(np.int64) + 128
    return np.clip((codes + bucket // 2) // bucket * bucket, 0, 255).astype(np.uint8).tobytes()


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
    codes = np.stack([packed >> np.uint32(shift) & np.uint32(1023) for shift in (20, 10, 0)], axis=-1)
    sizes = (codes & np.uint32(511)) / (_SMALLEST * math.sqrt(2))
    three = np.where(codes & np.uint32(512), -sizes, sizes)
    return checks.quats_of_three(three, packed >> np.uint32(30))[:, [3, 0, 1, 2]]


def size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree from the header. Raises StudioError as `read`, for the header."""
    head, _ = _opened(path, checks.read_bytes(path))
    return head.count, head.degree


def read(path: Path, note: checks.Note) -> Gaussians:
    """Read an SPZ file of version 2, 3 or 4; `note` takes other extensions, which are skipped, and other axes than
    right, up, back: splats are turned to these, and mirrored if need be."""
    head, attributes, records = read_container(path)
    axes = _AXES[_axes(path, records, note)]
    if head.flags & _ANTIALIASED:
        note("trained with antialiasing, which is not rendered: thin splats look bolder")
    if others := head.flags & ~(_ANTIALIASED | _EXTENSIONS):
        note(f"flags 0x{others:02X} of the SPZ file are not known and ignored")
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
        "logit_opacities": checks.logits(opacities[:, 0] / 255),
        "sh": sh,
    }
    splats = checks.from_arrays(arrays)
    if axes == "RUB":
        return splats
    note(f"stored with x, y and z toward {axes} (right, up, back, ...): turned to RUB")
    return turned(splats, np.array([_DIRECTIONS[letter] for letter in axes], np.float64).T)


@dataclass(frozen=True)
class Head:
    """The header: version, count, SH degree, fractional bits of positions, flags (1: antialiased; 2: extensions)."""

    version: int
    count: int
    degree: int
    bits: int
    flags: int = 0

    @property
    def sizes(self) -> tuple[int, ...]:
        """Bytes of positions, opacities, colors, scales, rotations and SH."""
        per_splat = (9, 1, 3, 3, 3 if self.version == 2 else 4, 3 * ((self.degree + 1) ** 2 - 1))
        return tuple(self.count * size for size in per_splat)


def read_container(path: Path) -> tuple[Head, list[bytes], bytes]:
    """The header, the six attributes in the order of `Head.sizes`, of exactly these sizes, and the extension records.
    StudioError if the file is missing, damaged, not SPZ, out of range, of an unsupported version, or has more data than
    its size can hold."""
    data = checks.read_bytes(path)
    head, inflater = _opened(path, data)
    size = sum(head.sizes)
    checks.check_expansion(path, size, len(data))
    if head.version == _ZSTD_VERSION:
        return head, *_zstd_streams(path, data, head)
    records = _MOST_RECORDS if head.flags & _EXTENSIONS else 0
    if inflater is None:
        body = data[_HEAD.size : _HEAD.size + size + records]
    else:
        try:
            body = inflater.decompress(inflater.unconsumed_tail, size + records)
        except zlib.error as error:
            raise _damaged(path, error) from None
    if len(body) < size:
        raise checks.truncated(path, len(body), size)
    starts = [sum(head.sizes[:index]) for index in range(len(head.sizes))]
    attributes = [body[start : start + length] for start, length in zip(starts, head.sizes, strict=True)]
    return head, attributes, body[size:]


def write_container(path: Path, head: Head, attributes: list[bytes]) -> None:
    """Write a file of version 3 or 4, attributes as in `Head.sizes`. The same ones give the same bytes."""
    assert head.version in WRITTEN_VERSIONS
    fields = (_MAGIC, head.version, head.count, head.degree, head.bits, 0)
    if head.version != _ZSTD_VERSION:
        path.write_bytes(gzip.compress(b"".join([_HEAD.pack(*fields, 0), *attributes]), mtime=0))
        return
    kept = [data for data in attributes if data]
    frames = [zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(data) for data in kept]
    table = [_ENTRY.pack(len(frame), len(data)) for frame, data in zip(frames, kept, strict=True)]
    path.write_bytes(b"".join([_HEAD_4.pack(*fields, len(kept), _HEAD_4.size), *table, *frames]))


def _opened(path: Path, data: bytes) -> tuple[Head, Any]:
    """The header, and for gzipped files the zlib decompressor of the rest."""
    if data[:2] != b"\x1f\x8b":
        return _checked_head(path, data[: _HEAD.size]), None
    inflater = zlib.decompressobj(wbits=31)
    try:
        start = inflater.decompress(data, _HEAD.size)
    except zlib.error as error:
        raise _damaged(path, error) from None
    head = _checked_head(path, start)
    if head.version == _ZSTD_VERSION:
        raise checks.damaged("splat_file.unreadable", "an SPZ file of version 4 must not be gzipped", path)
    return head, inflater


def _checked_head(path: Path, head: bytes) -> Head:
    if len(head) < _HEAD.size or head[:4] != _MAGIC.to_bytes(4, "little"):
        raise checks.damaged("splat_file.unreadable", "not an SPZ file", path)
    _, version, count, degree, bits, flags, _ = _HEAD.unpack(head)
    if version not in VERSIONS:
        problem = f"SPZ version {version}; versions 2 to 4 are supported"
        fix = "Convert it, to PLY for example."
        raise StudioError("splat_file.unsupported_version", problem, file=path, value=version, fix=fix)
    if not 0 < count <= checks.MAX_SPLATS or degree > 3 or bits > 23:
        problem = (
            f"{count} splats of SH degree {degree} with {bits} fractional bits; expected 1 to {checks.MAX_SPLATS} "
            "splats, degree 0 to 3 and 0 to 23 bits"
        )
        fix = "Export it again, with SH of degree 3 at most."
        raise StudioError("splat_file.invalid_header", problem, file=path, value=(count, degree, bits), fix=fix)
    return Head(version, count, degree, bits, flags)


def _zstd_streams(path: Path, data: bytes, head: Head) -> tuple[list[bytes], bytes]:
    """The attributes, and the extension records."""
    if len(data) < _HEAD_4.size:
        raise checks.truncated(path, len(data), _HEAD_4.size)
    *_, streams, table = _HEAD_4.unpack_from(data)
    expected = [size for size in head.sizes if size]
    if streams != len(expected) or table < _HEAD_4.size:
        problem = (
            f"{streams} attributes, listed at byte {table}; expected {len(expected)} at byte {_HEAD_4.size} or later"
        )
        raise checks.damaged("splat_file.invalid_header", problem, path, (streams, table))
    position = table + streams * _ENTRY.size
    if position > len(data):
        raise checks.truncated(path, len(data), position)
    records = data[_HEAD_4.size : table] if head.flags & _EXTENSIONS else b""
    entries = [_ENTRY.unpack_from(data, table + index * _ENTRY.size) for index in range(streams)]
    end = position + sum(stored for stored, _ in entries)
    if end > len(data):
        raise checks.truncated(path, len(data), end)
    decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    result: list[bytes] = []
    for (stored, size), wanted in zip(entries, expected, strict=True):
        length = size
        if size == wanted:
            part = memoryview(data)[position : position + stored]
            try:
                # one byte more than promised is read, never more
                values = decompressor.stream_reader(part, read_across_frames=True).read(wanted + 1)
            except zstandard.ZstdError as error:
                raise _damaged(path, error) from None
            length = len(values)
        if length != wanted:
            raise checks.damaged(
                "splat_file.unreadable",
                f"the SPZ file is damaged (attribute {len(result)} has {length} bytes instead of {wanted})",
                path,
            )
        result.append(values)
        position += stored
    return [*result, *[b""] * (len(head.sizes) - len(result))], records


def _axes(path: Path, records: bytes, note: checks.Note) -> int:
    """Index in `_AXES`, from the extension records."""
    position, axes = 0, 0
    while position < len(records):
        if position + _RECORD.size > len(records):
            raise _extensions(path, "are cut off")
        kind, size = _RECORD.unpack_from(records, position)
        content = records[position + _RECORD.size : position + _RECORD.size + size]
        position += _RECORD.size + size
        if position > len(records):
            raise _extensions(path, "are cut off")
        if kind == _SH_EXTENSION:
            raise _extensions(path, f"change how SH are coded (0x{kind:08X}), which is not supported")
        if kind == _AXES_EXTENSION:
            axes = int.from_bytes(content, "little")
            if size != 4 or axes >= len(_AXES):
                raise _extensions(path, f"name an unknown coordinate system ({axes}; 0 to {len(_AXES) - 1} are known)")
        elif kind != _ORBIT_EXTENSION:
            note(f"SPZ extension 0x{kind:08X} is skipped")
    return axes


def _extensions(path: Path, problem: str) -> StudioError:
    fix = "Export the file without them."
    return StudioError("splat_file.extensions", f"the extensions of the SPZ file {problem}", file=path, fix=fix)


def _damaged(path: Path, error: Exception) -> StudioError:
    return checks.damaged("splat_file.unreadable", f"the SPZ file is damaged ({error})", path)
