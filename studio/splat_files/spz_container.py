"""The container of SPZ files: header and packed attributes as bytes; what they mean is in `spz`.

Source: README, extensions/README.md and source code of github.com/nianticlabs/spz (MIT). Versions 2 and 3: a 16-byte
header and one attribute after the other, all of it gzipped (or plain). Version 4: a plain 32-byte header, extension
records, a table of contents (compressed and uncompressed size of each attribute, uint64) and one Zstandard frame per
attribute; attributes without bytes are left out.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studio.errors import StudioError
from studio.splat_files.checks import EXPORT_AGAIN, MAX_SPLATS, check_expansion, read_bytes, truncated

VERSIONS = (2, 3, 4)
WRITTEN_VERSIONS = (3, 4)

_HEAD = struct.Struct("<IIIBBBB")  # magic, version, splats, SH degree, fractional bits, flags, streams (version 4)
_HEAD_4 = struct.Struct("<IIIBBBBI12x")  # the same and the offset of the table of contents
_ENTRY = struct.Struct("<QQ")
_RECORD = struct.Struct("<II")  # type and size of an extension
_MAGIC = 0x5053474E  # "NGSP"
_ZSTD_VERSION = 4
_EXTENSIONS = 0x2  # flag
# These change what the attributes mean: other quantization of SH, other axes. All others can be skipped.
_UNREADABLE_EXTENSIONS = {0xADBE0001, 0xADBE0003}
# Of 1 to 22. 31,900 trained splats: 1.5% fewer bytes than level 12, in 0.1 s; more does not help
_ZSTD_LEVEL = 19
_LARGEST_WINDOW = 1 << 27  # of Zstandard; what level 22 needs


@dataclass(frozen=True)
class Head:
    """The header.

    Attributes:
        version: 2, 3 or 4.
        count: splats, 1 to `MAX_SPLATS`.
        degree: of the spherical harmonics, 0 to 3.
        bits: fractional bits of a position, 0 to 23.
    """

    version: int
    count: int
    degree: int
    bits: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """Bytes of positions, opacities, colors, scales, rotations and SH."""
        per_splat = (9, 1, 3, 3, 3 if self.version == 2 else 4, 3 * ((self.degree + 1) ** 2 - 1))
        return tuple(self.count * size for size in per_splat)


def read_head(path: Path) -> Head:
    """The header alone. Raises StudioError as `read_container`, except for what comes after the header."""
    return _opened(path, read_bytes(path))[0]


def read_container(path: Path) -> tuple[Head, list[bytes]]:
    """The header and the six attributes in the order of `Head.sizes`, of exactly these sizes.

    Raises:
        StudioError: missing or damaged file, not an SPZ file, a header out of range, an unsupported version or
            extension, or more data than a file of this size can hold.
    """
    data = read_bytes(path)
    head, inflater = _opened(path, data)
    size = sum(head.sizes)
    check_expansion(path, size, len(data))
    if head.version == _ZSTD_VERSION:
        return head, _zstd_streams(path, data, head)
    if inflater is None:
        body = data[_HEAD.size : _HEAD.size + size]
    else:
        try:
            body = inflater.decompress(inflater.unconsumed_tail, size)
        except zlib.error as error:
            raise _damaged(path, error) from None
    if len(body) < size:
        raise truncated(path, len(body), size)
    starts = [sum(head.sizes[:index]) for index in range(len(head.sizes))]
    return head, [body[start : start + size] for start, size in zip(starts, head.sizes, strict=True)]


def write_container(path: Path, head: Head, attributes: list[bytes]) -> None:
    """Write a file of version 3 or 4. The same attributes give the same bytes.

    Args:
        path: file to write.
        head: what the header says.
        attributes: in the order and of the sizes of `Head.sizes`.
    """
    assert head.version in WRITTEN_VERSIONS
    fields = (_MAGIC, head.version, head.count, head.degree, head.bits, 0)
    if head.version != _ZSTD_VERSION:
        path.write_bytes(gzip.compress(b"".join([_HEAD.pack(*fields, 0), *attributes]), mtime=0))
        return
    import zstandard

    kept = [data for data in attributes if data]
    frames = [zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(data) for data in kept]
    table = [_ENTRY.pack(len(frame), len(data)) for frame, data in zip(frames, kept, strict=True)]
    path.write_bytes(b"".join([_HEAD_4.pack(*fields, len(kept), _HEAD_4.size), *table, *frames]))


def _opened(path: Path, data: bytes) -> tuple[Head, Any]:
    """The header, and for gzipped files the zlib decompressor of what follows."""
    if data[:2] != b"\x1f\x8b":
        return _checked_head(path, data[: _HEAD.size]), None
    inflater = zlib.decompressobj(wbits=31)
    try:
        start = inflater.decompress(data, _HEAD.size)
    except zlib.error as error:
        raise _damaged(path, error) from None
    head = _checked_head(path, start)
    if head.version == _ZSTD_VERSION:
        raise StudioError(
            "splat_file.unreadable", "an SPZ file of version 4 must not be gzipped", file=path, fix=EXPORT_AGAIN
        )
    return head, inflater


def _checked_head(path: Path, head: bytes) -> Head:
    if len(head) < _HEAD.size or head[:4] != _MAGIC.to_bytes(4, "little"):
        raise StudioError("splat_file.unreadable", "not an SPZ file", file=path, fix=EXPORT_AGAIN)
    _, version, count, degree, bits, flags, _ = _HEAD.unpack(head)
    if version not in VERSIONS:
        raise StudioError(
            "splat_file.unsupported_version",
            f"SPZ version {version}; versions 2 to 4 are supported",
            file=path,
            value=version,
            fix="Convert it, to PLY for example.",
        )
    if not 0 < count <= MAX_SPLATS or degree > 3 or bits > 23:
        raise StudioError(
            "splat_file.invalid_header",
            f"{count} splats of SH degree {degree} with {bits} fractional bits; expected 1 to {MAX_SPLATS} splats, "
            "degree 0 to 3 and 0 to 23 bits",
            file=path,
            value=(count, degree, bits),
        )
    if flags & _EXTENSIONS and version != _ZSTD_VERSION:
        raise _extensions(path)
    return Head(version, count, degree, bits)


def _zstd_streams(path: Path, data: bytes, head: Head) -> list[bytes]:
    import zstandard

    if len(data) < _HEAD_4.size:
        raise truncated(path, len(data), _HEAD_4.size)
    *_, flags, streams, table = _HEAD_4.unpack_from(data)
    expected = [size for size in head.sizes if size]
    if streams != len(expected) or table < _HEAD_4.size:
        raise StudioError(
            "splat_file.invalid_header",
            f"{streams} attributes, listed at byte {table}; expected {len(expected)} at byte {_HEAD_4.size} or later",
            file=path,
            value=(streams, table),
            fix=EXPORT_AGAIN,
        )
    position = table + streams * _ENTRY.size
    if position > len(data):
        raise truncated(path, len(data), position)
    if flags & _EXTENSIONS:
        _check_extensions(path, data[_HEAD_4.size : table])
    entries = [_ENTRY.unpack_from(data, table + index * _ENTRY.size) for index in range(streams)]
    end = position + sum(stored for stored, _ in entries)
    if end > len(data):
        raise truncated(path, len(data), end)
    decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    result: list[bytes] = []
    for (stored, size), wanted in zip(entries, expected, strict=True):
        found = size
        if size == wanted:
            part = memoryview(data)[position : position + stored]
            try:
                # one byte more than promised is read, never more
                values = decompressor.stream_reader(part, read_across_frames=True).read(wanted + 1)
            except zstandard.ZstdError as error:
                raise _damaged(path, error) from None
            found = len(values)
        if found != wanted:
            raise StudioError(
                "splat_file.unreadable",
                f"the SPZ file is damaged (attribute {len(result)} has {found} bytes instead of {wanted})",
                file=path,
                fix=EXPORT_AGAIN,
            )
        result.append(values)
        position += stored
    return [*result, *[b""] * (len(head.sizes) - len(result))]


def _check_extensions(path: Path, records: bytes) -> None:
    position = 0
    while position < len(records):
        if position + _RECORD.size > len(records):
            raise _extensions(path)
        kind, size = _RECORD.unpack_from(records, position)
        position += _RECORD.size + size
        if kind in _UNREADABLE_EXTENSIONS or position > len(records):
            raise _extensions(path)


def _extensions(path: Path) -> StudioError:
    return StudioError(
        "splat_file.extensions",
        "the SPZ file has extensions that are damaged or not supported",
        file=path,
        fix="Export the file without them.",
    )


def _damaged(path: Path, error: Exception) -> StudioError:
    return StudioError("splat_file.unreadable", f"the SPZ file is damaged ({error})", file=path, fix=EXPORT_AGAIN)
