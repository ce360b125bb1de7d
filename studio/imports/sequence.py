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
from studio.splat_files import UP, read_splats, splats_size
from studio.splat_video import SplatVideo

DEFAULT_FPS = 30.0
"""Default frame rate, because splat files do not store one."""

_SAMPLE = 4000  # number of splats compared to decide whether two frames have the same splats in the same order
# relative to the distance between two random splats: moving splats are far below, shuffled splats near 1
_SAME_ORDER = 0.3


def find_frames(place: Path) -> list[Path]:
    """The files of a sequence, sorted by the last number in their names.

    These are all .ply files of a folder; if there are none, all .spz files; or `place` itself if it is a file.

    Raises:
        StudioError: no files were found, or two files have the same number.
    """
    if place.is_file():
        return [place]
    if not place.is_dir():
        raise StudioError("import.not_found", "no such file or folder", file=place)
    for ending in UP:
        paths = [path for path in place.iterdir() if path.suffix.lower() == ending and not path.name.startswith(".")]
        if paths:
            break
    if not paths:
        raise StudioError(
            "import.no_files",
            "no .ply or .spz files in this folder",
            file=place,
            fix="Specify a folder with one file per frame.",
        )
    numbered = sorted((_number(path), path.name, path) for path in paths)
    for (number, _, path), (following, _, other) in itertools.pairwise(numbered):
        if number == following:
            raise StudioError(
                "import.duplicate_frame",
                f"{path.name} and {other.name} have the same frame number",
                file=place,
                value=number,
                fix="Keep one sequence per folder.",
                files=[path.name, other.name],
            )
    return [path for _, _, path in numbered]


def _number(path: Path) -> int:
    digits = re.findall(r"\d+", path.name.split(".")[0])
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
    up = np.array(UP[paths[0].suffix.lower()])
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
