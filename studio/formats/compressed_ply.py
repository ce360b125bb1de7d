"""Compressed PLY, the packed splats of PlayCanvas and SuperSplat (`.compressed.ply`): read only.

Source: the format's description and open-source reader and writer in github.com/playcanvas/splat-transform (MIT), and
files that it wrote. An element `chunk` has the ranges of 256 splats each; `vertex` has four uint32 per splat: position
and log scale in 11, 10 and 11 bits of their chunk's range, rotation as the index of the largest component in 2 bits
and the other three in 10 bits each, color and opacity in 8 bits each. An element `sh`, if present, has one byte per
higher SH coefficient, from -4 to 4, red first, then green, then blue. Axes are those of other PLY files.
"""

from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyListProperty

from v3studio.studio.errors import StudioError
from v3studio.studio.formats.checks import check_count, damaged, from_arrays, logits, quats_of_three
from v3studio.studio.gaussians import SH_C0, Gaussians

CHUNK = 256  # splats that share their ranges

_DEGREES = {0: 0, 9: 1, 24: 2, 45: 3}  # by the number of properties f_rest_*
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_SH_RANGE = 8.0


def is_compressed(ply: PlyData) -> bool:
    """Return whether the elements are those of a compressed PLY."""
    elements = {element.name: element for element in ply.elements}
    return "chunk" in elements and "vertex" in elements and _PACKED[0] in _types(elements["vertex"])


def compressed_size(path: Path, ply: PlyData) -> tuple[int, int]:
    """Number of splats and SH degree."""
    vertices, chunks = ply["vertex"], ply["chunk"]
    check_count(path, vertices.count)
    _need(path, vertices, _PACKED, "u4")
    ranges = [f"{end}_{name}" for end in ("min", "max") for name in ("x", "y", "z", "scale_x", "scale_y", "scale_z")]
    _need(path, chunks, ranges, "f4")
    if "min_r" in _types(chunks):
        _need(path, chunks, [f"{end}_{name}" for end in ("min", "max") for name in "rgb"], "f4")
    _need_rows(path, "chunk", chunks.count, -(-vertices.count // CHUNK))
    harmonics = [element for element in ply.elements if element.name == "sh"]
    if not harmonics:
        return vertices.count, 0
    _need_rows(path, "sh", harmonics[0].count, vertices.count)
    degree = sh_degree(path, harmonics[0])
    _need(path, harmonics[0], [prop.name for prop in harmonics[0].properties], "u1")
    return vertices.count, degree


def sh_degree(path: Path, element: PlyElement) -> int:
    """SH degree of an element's properties f_rest_*. StudioError (splat_file.sh_properties) if there is none."""
    rest = {prop.name for prop in element.properties if prop.name.startswith("f_rest_")}
    if len(rest) not in _DEGREES or rest != {f"f_rest_{index}" for index in range(len(rest))}:
        problem = f"{len(rest)} properties f_rest_*; expected 0, 9, 24 or 45 for SH degrees 0 to 3, numbered from 0"
        fix = "Export it again, with SH of degree 3 at most and all coefficients."
        raise StudioError("splat_file.sh_properties", problem, file=path, value=len(rest), fix=fix)
    return _DEGREES[len(rest)]


def read_compressed(path: Path, ply: PlyData) -> Gaussians:
    """The splats of a compressed PLY, as parsed; see `is_compressed`."""
    count, degree = compressed_size(path, ply)
    vertices, chunks = ply["vertex"].data, ply["chunk"].data
    words = {name: np.asarray(vertices[name], np.uint32) for name in _PACKED}
    chunk = np.arange(count) // CHUNK

    def ranged(levels: np.ndarray, names: list[str]) -> np.ndarray:
        low, high = (
            np.stack([np.asarray(chunks[f"{end}_{name}"], np.float32) for name in names], axis=-1)
            for end in ("min", "max")
        )
        return low[chunk] * (1 - levels) + high[chunk] * levels

    bytes_ = np.stack([words["packed_color"] >> np.uint32(shift) & np.uint32(255) for shift in (24, 16, 8, 0)], axis=-1)
    colors, opacities = bytes_[:, :3] / 255, bytes_[:, 3] / 255
    if "min_r" in chunks.dtype.names:
        colors = ranged(colors, list("rgb"))
    rest = (degree + 1) ** 2 - 1
    sh = np.empty((count, rest + 1, 3), np.float32)
    sh[:, 0] = (colors - 0.5) / SH_C0
    if rest:
        data = ply["sh"].data
        codes = np.stack([np.asarray(data[f"f_rest_{index}"]) for index in range(3 * rest)], axis=-1)
        # inner codes stand for the middles of 256 equal intervals, the outer two for the ends of the range
        levels = np.where(codes == 0, 0, np.where(codes == 255, 1, (codes + 0.5) / 256))
        sh[:, 1:] = ((levels - 0.5) * _SH_RANGE).reshape(count, 3, rest).transpose(0, 2, 1)
    with np.errstate(invalid="ignore"):  # a range may be damaged
        means = ranged(_levels(words["packed_position"]), list("xyz"))
        log_scales = ranged(_levels(words["packed_scale"]), ["scale_x", "scale_y", "scale_z"])
    turns = words["packed_rotation"]  # the three stored components follow in their order; the largest is positive
    stored = np.stack([(turns >> np.uint32(shift) & np.uint32(1023)) / 1023 for shift in (20, 10, 0)], axis=-1)
    return from_arrays(
        {
            "means": means,
            "quats": quats_of_three((stored - 0.5) * 2**0.5, turns >> np.uint32(30)),
            "log_scales": log_scales,
            "logit_opacities": logits(opacities),
            "sh": sh,
        }
    )


def _levels(words: np.ndarray) -> np.ndarray:
    """(N, 3) from 0 to 1: 11, 10 and 11 bits, from the top."""
    return np.stack(
        [(words >> np.uint32(21)) / 2047, (words >> np.uint32(11) & np.uint32(1023)) / 1023, (words & 2047) / 2047],
        axis=-1,
    )


def _types(element: PlyElement) -> dict[str, str]:
    """NumPy type of each scalar property, without byte order."""
    return {
        prop.name: prop.val_dtype.lstrip("<>=|") for prop in element.properties if not isinstance(prop, PlyListProperty)
    }


def _need(path: Path, element: PlyElement, names: list[str] | tuple[str, ...], kind: str) -> None:
    types = _types(element)
    for name in names:
        if types.get(name) != kind:
            problem = f"the compressed PLY's element '{element.name}' has no property '{name}' of the type {kind}"
            fix = "Choose a file written by SuperSplat or a compatible tool."
            raise StudioError("splat_file.not_splats", problem, file=path, fix=fix, missing=name)


def _need_rows(path: Path, name: str, found: int, expected: int) -> None:
    if found != expected:
        problem = f"the compressed PLY's element '{name}' has {found} rows; its splats need {expected}"
        raise damaged("splat_file.invalid_header", problem, path, found, expected=expected)
