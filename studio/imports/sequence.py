"""Reads folders of numbered splat files, one per frame, from other programs or from `studio.export.sequence`."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.splat_files import META, READERS, UP, ending_of, is_sog_meta, read_splats, splats_size
from studio.splat_video import SplatVideo

DEFAULT_FPS = 30.0
"""Default frame rate, because splat files do not store one."""

_ENDINGS = frozenset(UP)

_SAMPLE = 4000  # number of splats compared to decide whether two frames have the same splats in the same order
# relative to the distance between two random splats: moving splats are far below, shuffled splats near 1
_SAME_ORDER = 0.3


def formats_in(folder: Path) -> dict[str, list[Path]]:
    """Files of each splat format in a folder, one per frame; hidden files do not count.

    Keys are extensions, `meta.json` for a SOG data set that lies open in the folder, and `*/meta.json` for folders with
    one each. Formats that are only written count, too, so that a folder with one of them besides another is noticed.
    """
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        kind = path.suffix.lower()
        if path.is_dir():
            kind, path = f"*/{META}", path / META
        elif path.name.lower() == META:
            kind = META
        if (path.name.lower() == META and path.is_file() and is_sog_meta(path)) or kind in _ENDINGS:
            found.setdefault(kind, []).append(path)
    return found


def check_one_format(folder: Path, formats: dict[str, list[Path]]) -> None:
    """Refuse a folder that mixes formats, rather than read a part of it.

    Args:
        folder: for the message.
        formats: as `formats_in` returns.

    Raises:
        StudioError: files of more than one format (import.mixed_formats).
    """
    if len(formats) > 1:
        examples = [str(paths[0].relative_to(folder)) for paths in formats.values()]
        raise StudioError(
            "import.mixed_formats",
            f"the folder mixes formats ({', '.join(formats)}), among them {' and '.join(examples)}",
            file=folder,
            value=list(formats),
            fix="Keep one sequence of one format per folder.",
            files=examples,
        )


def find_frames(place: Path) -> list[Path]:
    """The files of a sequence, sorted by the last number in their names; or `place` itself if it is a file.

    A SOG data set that is not bundled is one frame, named by its folder.

    Raises:
        StudioError: no files were found, more than one format, two files with the same number, or a stream
            (import.is_a_stream).
    """
    if place.is_file():
        if place.suffix.lower() == ".v3s":
            raise StudioError(
                "import.is_a_stream",
                "is a stream already, not splats of another program",
                file=place,
                fix="Play it with `v3studio play`, or write its splats with `v3studio export --format ply`.",
            )
        return [place]
    if not place.is_dir():
        raise StudioError("import.not_found", "no such file or folder", file=place)
    formats = formats_in(place)
    check_one_format(place, formats)
    paths = [path for found in formats.values() for path in found if ending_of(path) in READERS]
    if not paths:
        raise StudioError(
            "import.no_files",
            f"no {', '.join(READERS)} files in this folder",
            file=place,
            fix="Specify a folder with one file per frame.",
        )
    numbered = sorted((_number(_label(path)), _label(path), path) for path in paths)
    for (number, name, _), (following, other, _) in itertools.pairwise(numbered):
        if number == following:
            raise StudioError(
                "import.duplicate_frame",
                f"{name} and {other} have the same frame number",
                file=place,
                value=number,
                fix="Keep one sequence per folder.",
                files=[name, other],
            )
    return [path for _, _, path in numbered]


def _label(path: Path) -> str:
    """The name that says which frame it is: that of the folder for a `meta.json`."""
    return path.parent.name if path.name.lower() == META else path.name


def _number(name: str) -> int:
    digits = re.findall(r"\d+", name.split(".")[0])
    return int(digits[-1]) if digits else -1


def open_sequence(place: Path, fps: float = DEFAULT_FPS, progress: ProgressFn = no_progress) -> SplatVideo:
    """Open a folder of splat files, or one file, as a video.

    A new group starts where the number or the order of the splats changes.

    Args:
        place: folder or file; see `find_frames`.
        fps: frame rate of playback.
        progress: called with scanned and total files.

    Raises:
        StudioError: there are no files, or a file is damaged. Since files are not read completely here, reading a frame
            may also raise it.
    """
    paths = find_frames(place)
    sizes = [splats_size(path) for path in paths]
    degrees = {degree for _, degree in sizes}
    degree = max(degrees)

    def read(index: int) -> Gaussians:
        return read_splats(paths[index]).with_sh_degree(degree)

    starts = find_groups([count for count, _ in sizes], read, progress)
    up = np.array(UP[ending_of(paths[0])])
    return SplatVideo(str(place), fps, len(paths), starts, read, up=up)


def find_groups(
    counts: list[int], read: Callable[[int], Gaussians], progress: ProgressFn = no_progress
) -> tuple[int, ...]:
    """The first frames of the groups, which are maximal runs of frames with the same splats in the same order.

    Args:
        counts: number of splats per frame.
        read: reads a frame.
        progress: called with scanned and total frames.
    """
    starts = [0]
    before: np.ndarray | None = None
    generator = np.random.default_rng(0)
    for index, count in enumerate(counts):
        progress(index, len(counts))
        follows = index + 1 < len(counts) and counts[index + 1] == count
        if before is None and not follows:
            if index > 0:
                starts.append(index)
            continue
        means = read(index).means.numpy()
        if index > 0 and (before is None or not _same_splats(before, means, generator)):
            starts.append(index)
        before = means if follows else None
    progress(len(counts), len(counts))
    return tuple(starts)


def _same_splats(before: np.ndarray, after: np.ndarray, generator: np.random.Generator) -> bool:
    picked = generator.integers(len(before), size=min(_SAMPLE, 4 * len(before)))
    others = generator.integers(len(before), size=len(picked))
    moved = np.median(np.linalg.norm(after[picked] - before[picked], axis=1))
    apart = np.median(np.linalg.norm(after[others] - before[picked], axis=1))
    return bool(moved <= _SAME_ORDER * apart)
