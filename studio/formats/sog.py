"""SOG, the splats of PlayCanvas in images (version 2): read only, as a `.sog` bundle or as `meta.json` with its images.

Source: the format's specification, "The SOG Format", developer.playcanvas.com, and files written by splat-transform.
Pixel i of each image belongs to splat i, row by row. Positions have 16 bits in two images, over a range of their signed
logarithm; scales and colors are indices of a codebook; the quaternion's three smallest components have 8 bits each and
alpha says which one is missing; the color's alpha is the opacity. Higher SH are the entries of a palette: a label of 16
bits per splat, and 64 entries per row of the palette's image.

The specification calls +y up; splat-transform and SuperSplat write the axes of the PLY that they read, and viewers turn
both over. Here files have the axes of PLY.

Reads never more than the promised splats need: sizes of parts and images are checked before they are unpacked.
"""

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

from v3studio.studio.bounded_files import TextError, parse_json
from v3studio.studio.errors import StudioError
from v3studio.studio.formats import META, checks
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.json_types import JsonObject

_LARGEST_META = 1 << 20
_LARGEST_PART = 1 << 30
# An image may be larger than its splats need, since its sides are rounded up
_SPARE_PIXELS = 1 << 16
_VERSION = 2
_CODES = 256
_LABELS = 1 << 16
_ENTRIES_PER_ROW = 64
_LARGEST_COMPONENT = 252  # alpha of a quaternion is this plus the index of the component that is not stored


def is_sog_meta(path: Path) -> bool:
    """Return whether a `meta.json` seems to belong to a SOG data set; True if it cannot be parsed."""
    try:
        meta = _parsed(path)
    except StudioError:
        return True
    return "means" in meta and "quats" in meta


def size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree from `meta.json`. Raises StudioError as `read`, for `meta.json`."""
    meta = _Meta(path)
    return meta.count, meta.degree


def read(path: Path, note: checks.Note) -> Gaussians:
    """Read a SOG data set. `path`: a .sog file, or a meta.json with its images beside it."""
    meta = _Meta(path)

    def pixels(section: str, index: int = 0) -> np.ndarray:
        """(count, 4) uint8."""
        return _read_pixels(path, meta.file(section, index), meta.count).reshape(-1, 4)[: meta.count]

    low, high = (pixels("means", index)[:, :3].astype(np.float64) for index in range(2))
    least, most = meta.numbers("means", "mins", 3), meta.numbers("means", "maxs", 3)
    logarithms = least + (most - least) * ((low + 256 * high) / 65535)
    with np.errstate(over="ignore"):
        means = np.sign(logarithms) * np.expm1(np.abs(logarithms))
    colors = pixels("sh0")
    sh = meta.numbers("sh0", "codebook", _CODES)[colors[:, :3]][:, None]
    if meta.degree:
        sh = np.concatenate([sh, _harmonics(path, meta, pixels("shN", 1))], axis=1)
    return checks.from_arrays(
        {
            "means": means,
            "quats": _quats(path, meta, pixels("quats")),
            "log_scales": meta.numbers("scales", "codebook", _CODES)[pixels("scales")[:, :3]],
            "logit_opacities": checks.logits(colors[:, 3] / 255),
            "sh": sh,
        }
    )


def _parsed(path: Path) -> JsonObject:
    try:
        values = parse_json(_part(path, META))
    except TextError as error:
        raise checks.damaged("splat_file.sog_meta", f"{META} is not JSON ({error})", path, name=META) from None
    if not isinstance(values, dict):
        raise checks.damaged("splat_file.sog_meta", f"{META} is not an object", path, name=META)
    return values


class _Meta:
    """`meta.json`, with version, number of splats and SH degree validated; the rest is when it is asked for."""

    def __init__(self, path: Path) -> None:
        self._path, self._values = path, _parsed(path)
        version = self._values.get("version")
        if version != _VERSION:
            problem = "SOG of the first version (without 'version')" if version is None else f"SOG version {version!r}"
            fix = f"Version {_VERSION} is supported: export it again with a current version of its program."
            raise StudioError(
                "splat_file.unsupported_version", problem, file=self._path, value=version, fix=fix, expected=_VERSION
            )
        count = self._values.get("count")
        if not isinstance(count, int) or isinstance(count, bool):
            raise self.invalid("count", "must be an integer")
        checks.check_count(self._path, count)
        self.count: int = count
        self.degree: int = 0
        self.entries: int = 0
        if self._values.get("shN") is not None:
            bands, entries = (self._section("shN").get(name) for name in ("bands", "count"))
            if isinstance(bands, bool) or bands not in (1, 2, 3):
                raise self.invalid("shN.bands", "must be 1, 2 or 3")
            if isinstance(entries, bool) or not isinstance(entries, int) or not 0 < entries <= _LABELS:
                raise self.invalid("shN.count", f"must be an integer from 1 to {_LABELS}")
            self.degree, self.entries = bands, entries

    def invalid(self, name: str, problem: str) -> StudioError:
        """The error for a value of `meta.json`."""
        return checks.damaged("splat_file.sog_meta", f"'{name}' {problem}", self._path, name=name)

    def _section(self, name: str) -> JsonObject:
        section = self._values.get(name)
        if not isinstance(section, dict):
            raise self.invalid(name, "is missing or not an object")
        return section

    def file(self, section: str, index: int) -> str:
        """Name of one of a section's images: a file of the same folder."""
        files = self._section(section).get("files")
        name = files[index] if isinstance(files, list) and len(files) > index else None
        if not isinstance(name, str) or not name or name != Path(name).name or "\\" in name or "\0" in name:
            raise self.invalid(f"{section}.files", "must name files of the same folder")
        return name

    def numbers(self, section: str, name: str, count: int) -> np.ndarray:
        """(count,) float64, finite."""
        values = self._section(section).get(name)
        if (
            not isinstance(values, list)
            or len(values) != count
            or any(isinstance(value, bool) or not isinstance(value, int | float) for value in values)
        ):
            raise self.invalid(f"{section}.{name}", f"must be a list of {count} numbers")
        try:
            numbers = np.array(values, np.float64)
        except OverflowError:
            numbers = np.array([np.inf])
        if not np.isfinite(numbers).all():
            raise self.invalid(f"{section}.{name}", "has a number that is not finite")
        return numbers


def _quats(path: Path, meta: _Meta, pixels: np.ndarray) -> np.ndarray:
    """(N, 4) wxyz; the component that is not stored is positive."""
    largest = pixels[:, 3].astype(np.int64) - _LARGEST_COMPONENT
    if (largest < 0).any():
        splat = int((largest < 0).argmax())
        name = meta.file("quats", 0)
        problem = f"{name}: alpha of splat {splat} is {pixels[splat, 3]}; rotations have 252 to 255"
        raise checks.damaged("splat_file.sog_image", problem, _place(path, name), int(pixels[splat, 3]), name=name)
    stored = (pixels[:, :3] / 255 * 2 - 1) / 2**0.5
    return checks.quats_of_three(stored, largest)


def _harmonics(path: Path, meta: _Meta, pixels: np.ndarray) -> np.ndarray:
    """(N, K - 1, 3): each splat's entry of the palette."""
    rest = (meta.degree + 1) ** 2 - 1
    name = meta.file("shN", 0)
    rows = -(-meta.entries // _ENTRIES_PER_ROW)
    palette = _read_pixels(path, name, rows * _ENTRIES_PER_ROW * rest)
    if palette.shape[1] != _ENTRIES_PER_ROW * rest:
        problem = (
            f"{name}: {palette.shape[1]} pixels wide; a palette of degree {meta.degree} has {_ENTRIES_PER_ROW * rest}"
        )
        raise checks.damaged("splat_file.sog_image", problem, _place(path, name), palette.shape[1], name=name)
    labels = pixels[:, :2].astype(np.int64) @ [1, 256]
    if labels.max() >= meta.entries:
        raise meta.invalid("shN.count", f"is {meta.entries}, but a splat has entry {labels.max()}")
    codes = palette[..., :3].reshape(-1, rest, 3)[labels]
    return meta.numbers("shN", "codebook", _CODES)[codes]


def _place(path: Path, name: str) -> Path:
    """The file that has a part of a data set, for messages. `path`: as for `read`."""
    return path if path.name.lower() != META or name == META else path.parent / name


def _part(path: Path, name: str) -> bytes:
    """A part of a data set. StudioError: it is missing, damaged or too large."""
    if path.name.lower() != META:
        return _member(path, name)
    place = _place(path, name)
    if place.is_file():
        _check_size(place, name, place.stat().st_size)
    return checks.read_bytes(place)


def _member(path: Path, name: str) -> bytes:
    # decided here, since zipfile searches the whole file for an archive
    with checks.opening(path), path.open("rb") as file:
        start = file.read(2)
    if start != b"PK":
        raise checks.damaged("splat_file.unreadable", "not a SOG bundle (ZIP)", path)
    try:
        with zipfile.ZipFile(path) as archive:
            info = archive.getinfo(name)
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise zipfile.BadZipFile(f"{name} is compressed by method {info.compress_type}")
            _check_size(path, name, info.file_size)
            checks.check_expansion(path, info.file_size, info.compress_size)
            with archive.open(info) as member:
                return member.read(info.file_size)
    except KeyError:
        raise checks.damaged("splat_file.sog_part_missing", f"the SOG bundle has no {name}", path, name=name) from None
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError, struct.error) as error:
        raise checks.damaged("splat_file.unreadable", f"the SOG bundle is damaged ({error})", path) from None


def _read_pixels(path: Path, name: str, least: int) -> np.ndarray:
    """(height, width, 4) uint8 RGBA of a lossless WebP or PNG image with at least so many pixels."""
    from PIL import Image

    data = _part(path, name)

    def invalid(problem: str, value: object = None) -> StudioError:
        return checks.damaged("splat_file.sog_image", f"{name}: {problem}", _place(path, name), value, name=name)

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
        raise checks.damaged(
            "splat_file.expansion", f"{name} has {size} bytes; expected at most {limit}", path, size, expected=limit
        )
