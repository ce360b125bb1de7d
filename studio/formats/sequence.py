"""Sequences of splat files, one per frame, read and written."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from studio.errors import StudioError
from studio.formats import (
    DEFAULT_FPS,
    FRAME_FILES,
    META,
    READ_SUFFIXES,
    read_splats,
    splats_size,
    suffix_of,
    write_splats,
)
from studio.formats.placing import new_file, new_folder
from studio.formats.rigid_motion import turned, upright
from studio.formats.sog import is_sog_meta
from studio.formats.videogs import is_videogs, open_videogs
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.splat_video import SplatVideo

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
        if (path.name.lower() == META and path.is_file() and is_sog_meta(path)) or kind in FRAME_FILES:
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
    paths = [path for found in formats.values() for path in found if suffix_of(path) in READ_SUFFIXES]
    if not paths:
        raise StudioError(
            "import.no_files",
            f"no {', '.join(READ_SUFFIXES)} files in this folder",
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
    up = np.array(FRAME_FILES[suffix_of(paths[0])].up)
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


def open_import(place: Path, fps: float = DEFAULT_FPS, progress: ProgressFn = no_progress) -> SplatVideo:
    """Open the VideoGS layout, a folder of splat files of one format (see `studio.formats`), or a single such file.

    Args:
        place: folder or file.
        fps: frame rate of playback, which none of these formats stores.
        progress: called with scanned and total files.

    Raises:
        StudioError: the input has none of these formats or more than one of them, or its files are damaged.
    """
    if is_videogs(place):
        check_one_format(place, {"VideoGS": [place / "group_info.json"], **formats_in(place)})
        return open_videogs(place, fps)
    return open_sequence(place, fps, progress)


def axes_of(video: SplatVideo, suffix: str, upright_for_viewers: bool) -> np.ndarray | None:
    """The (3, 3) rotation to apply for a file format, or None to keep the world axes.

    Args:
        video: provides the up and front directions.
        suffix: a key of `FRAME_FILES`.
        upright_for_viewers: rotate to the up convention of the format, with the side that faces the video's view to the
            front.
    """
    if not upright_for_viewers:
        return None
    rotation = upright(video)
    # 3DGS files have y down and z pointing away from the viewer: 180 degrees about x
    return np.diag([1.0, -1.0, -1.0]) @ rotation if FRAME_FILES[suffix].up[1] < 0 else rotation


def export_sequence(
    video: SplatVideo,
    folder: Path,
    suffix: str,
    rotation: np.ndarray | None = None,
    progress: ProgressFn = no_progress,
    **options: Any,
) -> None:
    """Write `folder/frame_0000.ply`, ..., numbered as in the video.

    Args:
        video: the frames.
        folder: must not exist; appears only when it is complete.
        suffix: of a format in `FRAME_FILES` that is written.
        rotation: (3, 3) rotation from `axes_of`; None: no rotation.
        progress: called with written and total frames.
        options: of the format; see `write_splats`.

    Raises:
        StudioError: a frame cannot be read or represented in the format, or the folder exists or cannot be written.
    """
    digits = max(4, len(str(max(video.number(index) for index in range(video.frame_count)))))
    with new_folder(folder) as temporary:
        for index in range(video.frame_count):
            progress(index, video.frame_count)
            path = temporary / f"frame_{video.number(index):0{digits}d}{suffix}"
            write_splats(path, _rotated(video.read(index), rotation), **options)
        progress(video.frame_count, video.frame_count)


def export_frame(video: SplatVideo, path: Path, rotation: np.ndarray | None = None, **options: Any) -> None:
    """Write the first frame to a file, in the format of its extension. Raises StudioError as `export_sequence`."""
    with new_file(path) as temporary:
        write_splats(temporary, _rotated(video.read(0), rotation), **options)


def _rotated(gaussians: Gaussians, rotation: np.ndarray | None) -> Gaussians:
    return gaussians if rotation is None else turned(gaussians, rotation)
