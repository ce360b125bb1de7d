"""Files of other programs: the formats of splats and movies, each read and written in its own module.

`FORMATS` lists them. The command line, the window and the folder import read that table; the module of a format is only
imported when a file of it is read or written.

A module of a format with one file per frame has `read(path, note) -> Gaussians`, `size(path) -> (splats, SH degree)`
and `write(path, gaussians, **options)`, as far as its entry says. `note` takes what was ignored or assumed. Readers and
writers keep the axes of the format: `Format.up` is its conventional up direction, and `studio.formats.rigid_motion`
rotates splats to it.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from v3studio.studio.formats.checks import Note
    from v3studio.studio.gaussians import Gaussians

Up = tuple[float, float, float]
_COLMAP: Up = (0.0, -1.0, 0.0)  # 3DGS uses the axes of COLMAP cameras, and so do files converted from its PLY
_Y_UP: Up = (0.0, 1.0, 0.0)

DEFAULT_FPS = 30.0  # default frame rate of imports, because splat files do not store one
USD_SUFFIXES = (".usdc", ".usdz", ".usda", ".usd")  # extensions of USD files: the first three are written, all are read
META = "meta.json"  # names a SOG that lies unpacked in a folder


@dataclass(frozen=True)
class Option:
    """An option of a format with one file per frame."""

    keyword: str  # of the `write` of the format's module, which has the default
    kind: type
    help: str
    choices: tuple[Any, ...] | None = None


@dataclass(frozen=True)
class Format:
    """One format."""

    name: str  # of the module in `studio.formats`, and of `v3studio export --format`
    # "frame": one file per frame; "sequence": a folder or a file with all frames; "stream": one file; "movie":
    # rendered, one file; "plates": rendered, one file per frame
    holds: Literal["frame", "sequence", "stream", "movie", "plates"]
    suffix: str  # of its files; "" for a folder
    title: str  # for lists in the window
    written: str = ""  # what `v3studio export` writes, for its help; "" if the format is only read
    readable: bool = False  # whether `v3studio import` reads it, as far as it is a format of splats
    up: Up = _COLMAP  # conventional up direction; splats are rotated to it on export unless `keeps_axes`
    keeps_axes: bool = True  # whether exports have the axes of the capture by default
    follows_path: bool = False  # whether it is rendered along a camera path
    options: tuple[Option, ...] = ()

    @property
    def arguments(self) -> dict[str, Option]:
        """The options by their arguments of `v3studio export`, with underscores: `spz_version` is `version` of SPZ."""
        return {f"{self.name}_{option.keyword}": option for option in self.options}

    @property
    def module(self) -> Any:
        """The module that reads and writes it."""
        return importlib.import_module(f"v3studio.studio.formats.{self.name}")


FORMATS = (
    Format(
        "ply", "frame", ".ply", "PLY, one file per frame",
        "a folder of numbered 3DGS PLY files, or one .ply file",
        readable=True,
    ),
    Format(
        "spz", "frame", ".spz", "SPZ, one file per frame",
        "a folder of numbered SPZ files, or one .spz file; a quarter of the size of PLY or less",
        readable=True, up=_Y_UP, keeps_axes=False,
        options=(Option("version", int, "4 (default), or 3 for viewers that cannot read 4", (3, 4)),),
    ),
    Format(
        "glb", "frame", ".glb", "GLB, one file per frame",
        "a folder of numbered GLB files with KHR_gaussian_splatting, or one .glb file",
        up=_Y_UP, keeps_axes=False,
    ),
    Format("sog", "frame", ".sog", "SOG", readable=True),
    Format("splat", "frame", ".splat", ".splat", readable=True),
    Format(
        "videogs", "sequence", "", "VideoGS layout",
        "a folder in the VideoGS layout, for the players of the paper's released code",
    ),
    Format(
        "usd", "sequence", ".usdc", "USD, one file",
        "one .usdc or .usdz file with time samples, cameras and sound, for film tools",
        readable=True, up=_Y_UP, keeps_axes=False,
    ),
    Format(
        "v3", "stream", ".v3s", "Stream in one file",
        "one .v3s file with the whole stream as it is, which V3 Studio's players open",
    ),
    Format("turntable", "movie", ".mp4", "Movie: turntable", "an MP4 of a camera circling the performer"),
    Format(
        "camera-path", "movie", ".mp4", "Movie: camera path", "an MP4 along the cameras in --path", follows_path=True
    ),
    Format(
        "exr", "plates", ".exr", "EXR plates: camera path",
        "a folder of numbered EXR files for compositing: colors with alpha, depth, position, normals, motion",
        up=_Y_UP, keeps_axes=False, follows_path=True,
    ),
)  # fmt: skip
"""All formats, in the order in which they are listed."""

EXPORTS = {one.name: one for one in FORMATS if one.written}  # formats of `v3studio export`, by name
FRAME_FILES = {one.suffix: one for one in FORMATS if one.holds == "frame"}  # formats with one file per frame, by suffix

READ_SUFFIXES = tuple(suffix for suffix, one in FRAME_FILES.items() if one.readable)


def suffix_of(path: Path) -> str:
    """The suffix in lower case that names a file's format; ".sog" for a `meta.json`."""
    return ".sog" if path.name.lower() == META else path.suffix.lower()


def _format(path: Path, known: Iterable[str], what: str, also: str = "") -> Format:
    suffix, suffixes = suffix_of(path), list(known)
    if suffix not in suffixes:
        problem = f"splats can be {what} {', '.join(suffixes)} files, not {path.suffix or 'a file without extension'}"
        fix = f"Convert it, or give the file the extension of its format.{also}"
        raise StudioError(
            "splat_file.unsupported_format", problem, file=path, value=path.suffix, fix=fix, expected=suffixes
        )
    return FRAME_FILES[suffix]


def _read_format(path: Path) -> Format:
    return _format(path, READ_SUFFIXES, "read from", " `v3studio import` reads USD, too.")


def ignore(note: str) -> None:
    """A `Note` for callers who do not show them."""


def read_rows(path: Path, note: Note = ignore) -> Gaussians:
    """All rows of a file of one frame, or of a SOG's meta.json, on the CPU; float64 if its positions are, else float32.
    Not all need be `usable` (see `studio.formats.checks`). StudioError if the extension is not supported, or the file
    is missing, damaged, has no splats, or has what would change their meaning and is not supported."""
    splats: Gaussians = _read_format(path).module.read(path, note)
    return splats


def read_splats(path: Path | str, note: Note = ignore) -> Gaussians:
    """Read splats like `read_rows`, in float32, without those that cannot be rendered (noted). Raises StudioError also
    if none is left."""
    path = Path(path)
    import torch

    from v3studio.studio.formats.checks import check_some_usable, usable

    rows = read_rows(path, note).to(torch.float32)
    kept = usable(rows)
    check_some_usable(path, kept)
    if kept.all():
        return rows
    note(dropped(int((~kept).sum())))
    return rows[kept]


def dropped(count: int) -> str:
    """The note on splats that cannot be rendered."""
    return f"{counted(count, 'splat')} dropped: a value that is not finite, an infinite scale or a zero quaternion"


def up_of(path: Path) -> Up:
    """Direction that points up in a file: what it says, if it says so, or the convention of its format."""
    known = _read_format(path)
    said: Up | None = known.module.said_up(path) if known.name == "ply" else None
    return known.up if said is None else said


def splats_size(path: Path) -> tuple[int, int]:
    """Number of splats and SH degree of a file, from its header only. Raises StudioError as `read_splats`."""
    count, degree = _read_format(path).module.size(path)
    return count, degree


def write_splats(gaussians: Gaussians, path: Path | str, **options: Any) -> None:
    """Write a file of one frame; `options` are of the format (SPZ: `version`, 3 or 4). Not atomic: callers write to a
    temporary name. StudioError if the extension is not supported, there are no splats, or a value is not finite or out
    of range."""
    path = Path(path)
    written = [suffix for suffix, format_ in FRAME_FILES.items() if format_.written]
    _format(path, written, "written to").module.write(path, gaussians, **options)
