"""Files with the splats of one frame: 3DGS PLY, SPZ, GLB with KHR_gaussian_splatting.

Readers and writers never change axes. `UP` is the conventional up direction of each format;
`studio.export.rigid_motion` rotates splats to it.
"""

from __future__ import annotations

from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.splat_files.glb import write_glb
from studio.splat_files.ply import ply_size, read_ply, write_ply
from studio.splat_files.spz import read_spz, spz_size, write_spz

READERS = {".ply": read_ply, ".spz": read_spz}
SIZERS = {".ply": ply_size, ".spz": spz_size}
WRITERS = {".ply": write_ply, ".spz": write_spz, ".glb": write_glb}

UP = {".ply": (0.0, -1.0, 0.0), ".spz": (0.0, 1.0, 0.0), ".glb": (0.0, 1.0, 0.0)}
"""Conventional up direction: 3DGS uses the axes of COLMAP cameras (y down); SPZ and glTF are y up."""


def _ending(path: Path, table: dict[str, object], what: str) -> str:
    ending = path.suffix.lower()
    if ending not in table:
        raise StudioError(
            "splat_file.unsupported_format",
            f"splats can be {what} {', '.join(table)} files, not {path.suffix!r}",
            file=path,
            value=path.suffix,
            expected=list(table),
        )
    return ending


def read_splats(path: Path) -> Gaussians:
    """Read the splats of a .ply or .spz file as float32 on the CPU.

    Raises:
        StudioError: the extension is not supported, or the file is missing, damaged or does not contain splats.
    """
    return READERS[_ending(path, dict(READERS), "read from")](path)


def splats_size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree of a file, from its header only. Raises StudioError as `read_splats`."""
    return SIZERS[_ending(path, dict(SIZERS), "read from")](path)


def write_splats(path: Path, gaussians: Gaussians) -> None:
    """Write a .ply, .spz or .glb file. Not atomic: callers write to a temporary name.

    Raises:
        StudioError: the extension is not supported, there are no splats, or a value is not finite or outside the range
            of the format.
    """
    WRITERS[_ending(path, dict(WRITERS), "written to")](path, gaussians)


__all__ = ["UP", "read_splats", "splats_size", "write_splats"]
