"""The parts of a SOG data set: `meta.json` and images, in a ZIP archive (`.sog`) or beside each other in a folder.

Reads never more than the splats that are promised need: sizes of parts and images are checked before they are unpacked.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Protocol

import numpy as np

from studio.errors import StudioError
from studio.splat_files.checks import EXPORT_AGAIN, check_expansion, read_bytes

META = "meta.json"

_LARGEST_META = 1 << 20
_LARGEST_PART = 1 << 30
# An image may be larger than its splats need, since its sides are rounded up
_SPARE_PIXELS = 1 << 16


class Parts(Protocol):
    """The files of one data set."""

    def read(self, name: str) -> bytes:
        """A file's content. Raises StudioError: it is missing, damaged or too large."""

    def path(self, name: str) -> Path:
        """The file, or the archive with it, for messages."""


class FolderParts:
    """Files beside a `meta.json`."""

    def __init__(self, meta: Path) -> None:
        self._folder = meta.parent
        self._meta = meta

    def path(self, name: str) -> Path:
        """The file itself."""
        return self._meta if name == META else self._folder / name

    def read(self, name: str) -> bytes:
        """A file's content."""
        path = self.path(name)
        if path.is_file():
            _check_size(path, name, path.stat().st_size)
        return read_bytes(path)


class ArchiveParts:
    """Members of a ZIP archive."""

    def __init__(self, archive: Path) -> None:
        self._archive = archive
        # decided here, since zipfile searches the whole file for an archive
        if not read_start(archive).startswith(b"PK"):
            raise StudioError("splat_file.unreadable", "not a SOG bundle (ZIP)", file=archive, fix=EXPORT_AGAIN)

    def path(self, name: str) -> Path:
        """The archive."""
        return self._archive

    def read(self, name: str) -> bytes:
        """A member's content."""
        try:
            with zipfile.ZipFile(self._archive) as archive:
                info = archive.getinfo(name)
                if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise zipfile.BadZipFile(f"{name} is compressed by method {info.compress_type}")
                _check_size(self._archive, name, info.file_size)
                check_expansion(self._archive, info.file_size, info.compress_size)
                with archive.open(info) as member:
                    return member.read(info.file_size)
        except KeyError:
            raise _no_part(self._archive, name) from None
        except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, struct.error) as error:
            raise StudioError(
                "splat_file.unreadable",
                f"the SOG bundle is damaged ({error})",
                file=self._archive,
                fix=EXPORT_AGAIN,
            ) from None


def read_start(path: Path) -> bytes:
    """The first bytes of a file. Raises StudioError as `checks.read_bytes`."""
    try:
        with path.open("rb") as file:
            return file.read(4)
    except FileNotFoundError:
        raise StudioError("splat_file.not_found", "no such file", file=path) from None
    except OSError as error:
        raise StudioError("splat_file.unreadable", f"cannot be read ({error.strerror})", file=path) from None


def read_pixels(parts: Parts, name: str, least: int) -> np.ndarray:
    """(height, width, 4) uint8 RGBA of a lossless WebP or PNG image.

    Args:
        parts: the data set.
        name: of the file.
        least: pixels that are needed.

    Raises:
        StudioError: missing, damaged or lossy image, or one of another size than its splats need.
    """
    from PIL import Image

    data = parts.read(name)

    def invalid(problem: str, value: object = None) -> StudioError:
        return StudioError(
            "splat_file.sog_image",
            f"{name}: {problem}",
            file=parts.path(name),
            value=value,
            fix=EXPORT_AGAIN,
            name=name,
        )

    size = _image_size(data)
    if size is None:
        raise invalid("not a lossless WebP or PNG image")
    width, height = size
    if not least <= width * height <= 4 * least + _SPARE_PIXELS:
        raise invalid(f"{width}x{height} pixels do not fit {least} values", (width, height))
    try:
        with Image.open(io.BytesIO(data), formats=("WEBP", "PNG")) as image:
            pixels = np.asarray(image.convert("RGBA"))
    except (OSError, ValueError, SyntaxError, struct.error, zlib.error, Image.DecompressionBombError) as error:
        raise invalid(f"the image is damaged ({error})") from None
    if pixels.shape != (height, width, 4):
        raise invalid("the image is damaged (its headers disagree)")
    return pixels


def _image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height from the header; None unless it is a PNG or a lossless WebP.

    Sources: PNG specification, 11.2.2; WebP container and lossless bitstream specifications (developers.google.com).
    """
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return width, height
    if data[:4] != b"RIFF" or data[8:12] != b"WEBP" or len(data) < 30:
        return None
    if data[12:16] == b"VP8X":
        if b"VP8L" not in data[30:64]:  # only an ICC profile, which SOG images do not have, could come before it
            return None
        width, height = (1 + int.from_bytes(data[start : start + 3], "little") for start in (24, 27))
        return width, height
    if data[12:16] == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return None


def _check_size(path: Path, name: str, size: int) -> None:
    limit = _LARGEST_META if name == META else _LARGEST_PART
    if size > limit:
        raise StudioError(
            "splat_file.expansion",
            f"{name} has {size} bytes; expected at most {limit}",
            file=path,
            value=size,
            fix=EXPORT_AGAIN,
            expected=limit,
        )


def _no_part(path: Path, name: str) -> StudioError:
    return StudioError(
        "splat_file.sog_part_missing",
        f"the SOG bundle has no {name}",
        file=path,
        fix=EXPORT_AGAIN,
        name=name,
    )
