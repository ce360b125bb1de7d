"""`.ksplat`, the file of the web viewer GaussianSplats3D: read only.

Source: github.com/mkkellogg/GaussianSplats3D (MIT), release 0.4.7. A header of 4096 bytes, headers of 1024 bytes for
each section, then the sections: buckets of neighboring splats, and the splats. Three levels of compression:

- 0: float32; SH as float32.
- 1: positions in 16 bits relative to the middle of their bucket, the rest as float16.
- 2: as 1, with SH in 8 bits over a range that the header has.

Scales are linear, colors and opacities 8 bits, rotations wxyz. SH (degree 0 to 2) have one band after the other, in
each band red first, then green, then blue. Axes are those of PLY files. The splats are in another order than in the
file that they were converted from.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.formats import checks
from v3studio.studio.gaussians import SH_C0, Gaussians

_HEAD_SIZE, _SECTION_HEAD_SIZE = 4096, 1024
_HEAD = struct.Struct("<BB2xI4xIIH14xff")  # version, sections, (used), most splats, splats, level, (center), SH range
_SECTION = struct.Struct("<IIIIfH2xI4xIIH")
_DEFAULT_SH_RANGE = (-1.5, 1.5)
_DEFAULT_LEVELS = {0: 1, 1: 32767, 2: 32767}  # steps of a position from the middle of a bucket to its side
_MAX_DEGREE = 2
_MAX_SECTIONS = 1 << 16


@dataclass(frozen=True)
class _Head:
    sections: int
    count: int
    level: int
    sh_range: tuple[float, float]


@dataclass(frozen=True)
class _Section:
    """A section's header."""

    start: int  # of its buckets in the file
    count: int  # count, capacity: splats that it has, and that it has room for
    capacity: int
    bucket_size: int
    buckets: int  # buckets, bucket_bytes: number of buckets, bytes of each one's middle
    bucket_bytes: int
    block: float  # side of a bucket, world units
    levels: int  # steps of a position from the middle of a bucket to its side
    full: int  # full, partial: buckets that are full, and those after them that are not
    partial: int
    degree: int


def size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree from the headers. Raises StudioError as `read`, for the headers."""
    data = checks.read_bytes(path)
    head = _head(path, data)
    return head.count, max(section.degree for section in _sections(path, data, head))


def read(path: Path, note: checks.Note) -> Gaussians:
    data = checks.read_bytes(path)
    head = _head(path, data)
    sections = list(_sections(path, data, head))
    coefficients = (max(section.degree for section in sections) + 1) ** 2
    parts = [_splats(path, data, head, section, coefficients) for section in sections if section.count]
    return checks.from_arrays({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def _head(path: Path, data: bytes) -> _Head:
    if len(data) < _HEAD_SIZE:
        raise checks.truncated(path, len(data), _HEAD_SIZE)
    major, minor, sections, _, count, level, low, high = _HEAD.unpack_from(data)
    if (major, minor) != (0, 1):
        problem = f"version {major}.{minor} of .ksplat, or another kind of file; version 0.1 is supported"
        fix = "Convert it, to PLY for example."
        raise StudioError("splat_file.unsupported_version", problem, file=path, value=f"{major}.{minor}", fix=fix)
    checks.check_count(path, count)
    if level not in _DEFAULT_LEVELS or not 0 < sections <= _MAX_SECTIONS:
        raise _invalid(path, f"compression level {level} and {sections} sections", (level, sections))
    return _Head(sections, count, level, (low or _DEFAULT_SH_RANGE[0], high or _DEFAULT_SH_RANGE[1]))


def _sections(path: Path, data: bytes, head: _Head) -> Iterator[_Section]:
    """The sections, each within the file, with as many splats in all as the header says."""
    start = _HEAD_SIZE + head.sections * _SECTION_HEAD_SIZE
    if len(data) < start:
        raise checks.truncated(path, len(data), start)
    counted = 0
    for number in range(head.sections):
        count, capacity, bucket_size, buckets, block, bucket_bytes, levels, full, partial, degree = (
            _SECTION.unpack_from(data, _HEAD_SIZE + number * _SECTION_HEAD_SIZE)
        )
        if count > capacity or degree > _MAX_DEGREE:
            problem = f"section {number} has {count} splats of SH degree {degree} and room for {capacity}"
            raise _invalid(path, problem, (count, degree, capacity))
        if head.level and (bucket_bytes != 12 or full + partial > buckets or full * bucket_size > count):
            problem = f"section {number} has {buckets} buckets of {bucket_bytes} bytes, {full} full, {partial} not"
            raise _invalid(path, problem, (buckets, bucket_bytes, full, partial))
        section = _Section(
            start, count, capacity, bucket_size, buckets, bucket_bytes, block,
            levels or _DEFAULT_LEVELS[head.level], full, partial, degree,
        )  # fmt: skip
        start += 4 * partial + bucket_bytes * buckets + capacity * _splat_type(head.level, degree).itemsize
        if start > len(data):
            raise checks.truncated(path, len(data), start)
        counted += count
        yield section
    if counted != head.count:
        raise _invalid(path, f"{counted} splats in sections, {head.count} in the header", (counted, head.count))


def _splat_type(level: int, degree: int) -> np.dtype:
    number = "<f4" if level == 0 else "<f2"
    harmonics = {0: "<f4", 1: "<f2", 2: "u1"}[level]
    return np.dtype(
        [
            ("mean", "<f4" if level == 0 else "<u2", 3),
            ("scale", number, 3),
            ("quat", number, 4),
            ("rgba", "u1", 4),
            ("sh", harmonics, 3 * ((degree + 1) ** 2 - 1)),
        ]
    )


def _splats(path: Path, data: bytes, head: _Head, section: _Section, coefficients: int) -> dict[str, np.ndarray]:
    """The attributes of a section, with SH padded to `coefficients` by zeros."""
    first = section.start + 4 * section.partial + section.bucket_bytes * section.buckets
    splats = np.frombuffer(data, _splat_type(head.level, section.degree), section.count, first)
    means = splats["mean"].astype(np.float64)
    if head.level:
        step = section.block / 2 / section.levels
        with np.errstate(invalid="ignore", over="ignore"):
            means = (means - section.levels) * step + _middles(path, data, section)
    rgba = splats["rgba"] / 255
    sh = np.zeros((section.count, coefficients, 3))
    sh[:, 0] = (rgba[:, :3] - 0.5) / SH_C0
    rest = splats["sh"].astype(np.float64)
    if head.level == 2:
        low, high = head.sh_range
        rest = low + rest / 255 * (high - low)
    for degree in range(1, section.degree + 1):
        start, size = degree**2, 2 * degree + 1
        band = rest[:, 3 * (start - 1) : 3 * (start - 1 + size)]
        sh[:, start : start + size] = band.reshape(section.count, 3, size).transpose(0, 2, 1)
    return {
        "means": means,
        "quats": splats["quat"].astype(np.float32),
        "log_scales": checks.log_scales(splats["scale"].astype(np.float64)),
        "logit_opacities": checks.logits(rgba[:, 3]),
        "sh": sh,
    }


def _middles(path: Path, data: bytes, section: _Section) -> np.ndarray:
    """(count, 3): the middle of each splat's bucket."""
    lengths = np.frombuffer(data, "<u4", section.partial, section.start).astype(np.int64)
    middles = np.frombuffer(data, "<f4", 3 * section.buckets, section.start + 4 * section.partial).reshape(-1, 3)
    held = section.full * section.bucket_size + int(lengths.sum())
    if not section.count <= held <= section.capacity:
        raise _invalid(path, f"buckets hold {held} of {section.count} splats", (held, section.count))
    sizes = np.concatenate([np.full(section.full, section.bucket_size, np.int64), lengths])
    return middles[np.repeat(np.arange(len(sizes)), sizes)[: section.count]].astype(np.float64)


def _invalid(path: Path, problem: str, value: object) -> StudioError:
    return checks.damaged(
        "splat_file.invalid_header", f"{problem}: the .ksplat file is damaged or of an unknown kind", path, value
    )
