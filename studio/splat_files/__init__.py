"""One frame's splats in the files of other programs: PLY of 3DGS, SPZ, GLB with KHR_gaussian_splatting.

Values are never turned or moved here: a file gets, and gives, the axes that its splats have. `UP` says which way is
up by each format's own convention; `studio.export.rigid_motion` turns splats to it.
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
"""Up by convention: 3DGS has the axes of its COLMAP cameras (y down), SPZ and glTF are y up."""


def _ending(path: Path, table: dict[str, object], what: str) -> str:
    ending = path.suffix.lower()
    if ending not in table:
        raise StudioError(f"{path}: splats are {what} {', '.join(table)} files, not '{path.suffix}'.")
    return ending


def read_splats(path: Path) -> Gaussians:
    """Read a .ply or .spz file, float32 on the CPU.

    Raises:
        StudioError: another ending, not there, damaged, or no file of splats.
    """
    return READERS[_ending(path, dict(READERS), "read from")](path)


def splats_size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree, from the file's head alone. Raises StudioError as `read_splats`."""
    return SIZERS[_ending(path, dict(SIZERS), "read from")](path)


def write_splats(path: Path, gaussians: Gaussians) -> None:
    """Write a .ply, .spz or .glb file in one go; the caller sees to it that a half-written one harms nobody.

    Raises:
        StudioError: another ending, no splats, a value that is not finite or that the format cannot hold.
    """
    WRITERS[_ending(path, dict(WRITERS), "written to")](path, gaussians)


__all__ = ["UP", "read_splats", "splats_size", "write_splats"]
