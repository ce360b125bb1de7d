"""The PLY files that 3DGS writes (Kerbl et al. 2023, `save_ply`), which nearly every program for splats reads.

One element `vertex` of float32 properties, little endian: x y z, nx ny nz (zeros), f_dc_0..2, f_rest_0.. (all
coefficients of red, then of green, then of blue), opacity (logit), scale_0..2 (logarithm), rot_0..3 (wxyz).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.splat_files.checks import MAX_SPLATS, from_arrays, to_arrays

if TYPE_CHECKING:
    from plyfile import PlyElement

_DEGREES = {0: 0, 9: 1, 24: 2, 45: 3}  # by the number of f_rest properties
_NEEDED = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


def write_ply(path: Path, gaussians: Gaussians) -> None:
    """Write a 3DGS PLY. Raises StudioError: no splats or values that are not finite."""
    from plyfile import PlyData, PlyElement

    arrays = to_arrays(path, gaussians)
    count = len(gaussians)
    rest = arrays["sh"][:, 1:].transpose(0, 2, 1).reshape(count, -1)
    columns = {
        **_columns("", "xyz", arrays["means"]),
        **_columns("n", "xyz", np.zeros((count, 3), np.float32)),
        **_columns("f_dc_", range(3), arrays["sh"][:, 0]),
        **_columns("f_rest_", range(rest.shape[1]), rest),
        "opacity": arrays["logit_opacities"],
        **_columns("scale_", range(3), arrays["log_scales"]),
        **_columns("rot_", range(4), arrays["quats"]),
    }
    vertices = np.empty(count, dtype=[(name, "<f4") for name in columns])
    for name, values in columns.items():
        vertices[name] = values
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(path))


def _columns(prefix: str, names: str | range, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{prefix}{name}": values[:, column] for column, name in enumerate(names)}


def ply_size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree. Raises StudioError as `read_ply`; the values are not looked at."""
    element = _vertices(path)
    return element.count, _degree(path, element)


def read_ply(path: Path) -> Gaussians:
    """Read a 3DGS PLY; other properties than those of splats are ignored.

    Raises:
        StudioError: not there, no PLY, damaged, a point cloud or mesh instead of splats, a compressed PLY.
    """
    element = _vertices(path)
    degree = _degree(path, element)
    rest = (degree + 1) ** 2 - 1
    data = element.data

    def stacked(names: list[str]) -> np.ndarray:
        return np.stack([np.asarray(data[name], np.float32) for name in names], axis=-1)

    sh = np.empty((element.count, rest + 1, 3), np.float32)
    sh[:, 0] = stacked(["f_dc_0", "f_dc_1", "f_dc_2"])
    if rest:
        channels = stacked([f"f_rest_{index}" for index in range(3 * rest)]).reshape(element.count, 3, rest)
        sh[:, 1:] = channels.transpose(0, 2, 1)
    return from_arrays(
        path,
        {
            "means": stacked(["x", "y", "z"]),
            "quats": stacked([f"rot_{index}" for index in range(4)]),
            "log_scales": stacked([f"scale_{index}" for index in range(3)]),
            "logit_opacities": np.asarray(data["opacity"], np.float32),
            "sh": sh,
        },
    )


def _vertices(path: Path) -> PlyElement:
    """The element with the splats, checked for its properties."""
    from plyfile import PlyData, PlyListProperty, PlyParseError

    try:
        ply = PlyData.read(str(path), mmap="r")
    except FileNotFoundError:
        raise StudioError(f"{path}: there is no such file.") from None
    except (PlyParseError, OSError, ValueError, MemoryError, OverflowError) as error:
        raise StudioError(f"{path}: this is not a readable PLY file ({error}); write or copy it again.") from None
    names = [element.name for element in ply.elements]
    if "chunk" in names and "vertex" in names and "packed_position" in ply["vertex"].data.dtype.names:
        raise StudioError(f"{path}: this is a compressed PLY; convert it to a plain one (SuperSplat and others do).")
    if "vertex" not in names:
        raise StudioError(f"{path}: the PLY file has no element 'vertex'; give one with splats.")
    element = ply["vertex"]
    scalar = {prop.name for prop in element.properties if not isinstance(prop, PlyListProperty)}
    missing = [name for name in _NEEDED if name not in scalar]
    if missing:
        raise StudioError(
            f"{path}: the PLY file has no property '{missing[0]}', so it holds no splats; give one that 3DGS or a "
            "program like it wrote."
        )
    if not 0 < element.count <= MAX_SPLATS:
        raise StudioError(f"{path}: the PLY file has {element.count} splats; 1 to {MAX_SPLATS} can be read.")
    return element


def _degree(path: Path, element: PlyElement) -> int:
    rest = {prop.name for prop in element.properties if prop.name.startswith("f_rest_")}
    if len(rest) not in _DEGREES or rest != {f"f_rest_{index}" for index in range(len(rest))}:
        raise StudioError(
            f"{path}: {len(rest)} properties f_rest_... found; SH degrees 0 to 3 have 0, 9, 24 or 45, counted from 0."
        )
    return _DEGREES[len(rest)]
