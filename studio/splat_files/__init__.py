"""Files with the splats of one frame, read and written by the formats' specifications.

| extension | format | read | written |
|---|---|---|---|
| .ply | 3DGS PLY; compressed PLY of PlayCanvas | yes | 3DGS PLY |
| .spz | Niantic SPZ, versions 2 to 4 | yes | versions 3 and 4 |
| .sog, meta.json | PlayCanvas SOG, version 2 | yes | |
| .splat | the first web viewers' | yes | |
| .ksplat | GaussianSplats3D's | yes | |
| .glb | glTF 2.0 with KHR_gaussian_splatting | | yes |

Readers and writers never change axes. `UP` is the conventional up direction of each format;
`studio.export.rigid_motion` rotates splats to it.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.splat_files.glb import write_glb
from studio.splat_files.ksplat import ksplat_size, read_ksplat
from studio.splat_files.ply import ply_size, read_ply, write_ply
from studio.splat_files.sog import is_sog_meta, read_sog, sog_size
from studio.splat_files.sog_files import META
from studio.splat_files.splat import read_splat, splat_size
from studio.splat_files.spz import DEFAULT_VERSION as SPZ_VERSION
from studio.splat_files.spz import read_spz, spz_size, write_spz
from studio.splat_files.spz_container import WRITTEN_VERSIONS as SPZ_VERSIONS

READERS = {".ply": read_ply, ".spz": read_spz, ".sog": read_sog, ".splat": read_splat, ".ksplat": read_ksplat}
SIZERS = {".ply": ply_size, ".spz": spz_size, ".sog": sog_size, ".splat": splat_size, ".ksplat": ksplat_size}
WRITTEN = (".ply", ".spz", ".glb")

UP = {
    ".ply": (0.0, -1.0, 0.0),
    ".spz": (0.0, 1.0, 0.0),
    ".sog": (0.0, -1.0, 0.0),
    ".splat": (0.0, -1.0, 0.0),
    ".ksplat": (0.0, -1.0, 0.0),
    ".glb": (0.0, 1.0, 0.0),
}
"""Conventional up direction: 3DGS uses the axes of COLMAP cameras (y down), and so do files converted from it to SOG,
.splat and .ksplat; SPZ and glTF are y up."""


def ending_of(path: Path) -> str:
    """The extension in lower case that names a file's format; ".sog" for a `meta.json`."""
    return ".sog" if path.name.lower() == META else path.suffix.lower()


def _ending(path: Path, known: Iterable[str], what: str) -> str:
    ending, endings = ending_of(path), list(known)
    if ending not in endings:
        raise StudioError(
            "splat_file.unsupported_format",
            f"splats can be {what} {', '.join(endings)} files, not {path.suffix or 'a file without extension'}",
            file=path,
            value=path.suffix,
            fix="Convert it, or give the file the extension of its format.",
            expected=endings,
        )
    return ending


def read_splats(path: Path) -> Gaussians:
    """Read the splats of a .ply, .spz, .sog, .splat or .ksplat file or of a SOG's meta.json as float32 on the CPU.

    Raises:
        StudioError: the extension is not supported, or the file is missing, damaged or does not contain splats.
    """
    return READERS[_ending(path, READERS, "read from")](path)


def splats_size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree of a file, from its header only. Raises StudioError as `read_splats`."""
    return SIZERS[_ending(path, SIZERS, "read from")](path)


def write_splats(path: Path, gaussians: Gaussians, spz_version: int = SPZ_VERSION) -> None:
    """Write a .ply, .spz or .glb file. Not atomic: callers write to a temporary name.

    Args:
        path: file to write.
        gaussians: one frame.
        spz_version: of a .spz file, 3 or 4.

    Raises:
        StudioError: the extension is not supported, there are no splats, or a value is not finite or outside the range
            of the format.
    """
    ending = _ending(path, WRITTEN, "written to")
    if ending == ".ply":
        write_ply(path, gaussians)
    elif ending == ".spz":
        write_spz(path, gaussians, spz_version)
    else:
        write_glb(path, gaussians)


__all__ = [
    "META",
    "READERS",
    "SPZ_VERSION",
    "SPZ_VERSIONS",
    "UP",
    "WRITTEN",
    "ending_of",
    "is_sog_meta",
    "read_splats",
    "splats_size",
    "write_splats",
]
