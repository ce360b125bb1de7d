"""Folders of numbered splat files, one a frame, made by other programs (or by `studio.export.sequence`)."""

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
"""Files of splats have no rate."""

_SAMPLE = 4000  # splats looked at to tell whether two frames have the same splats in the same order
_SAME_ORDER = (
    0.3  # of the distance between two splats picked at random; moving splats are far below, shuffled ones at 1
)


def find_frames(place: Path) -> list[Path]:
    """The files of a sequence, ordered by the last number in their names: all .ply (else .spz) files of a folder, or
    the one file that is named.

    Raises:
        StudioError: nothing there, or two files have the same number.
    """
    if place.is_file():
        return [place]
    if not place.is_dir():
        raise StudioError(f"{place}: there is no such file or folder.")
    for ending in UP:
        paths = [path for path in place.iterdir() if path.suffix.lower() == ending and not path.name.startswith(".")]
        if paths:
            break
    if not paths:
        raise StudioError(f"{place}: there are no .ply or .spz files in it; give a folder with one file a frame.")
    numbered = sorted((_number(path), path.name, path) for path in paths)
    for (number, _, path), (following, _, other) in itertools.pairwise(numbered):
        if number == following:
            raise StudioError(
                f"{place}: {path.name} and {other.name} have the same frame number; keep one sequence a folder."
            )
    return [path for _, _, path in numbered]


def _number(path: Path) -> int:
    digits = re.findall(r"\d+", path.name.split(".")[0])
    return int(digits[-1]) if digits else -1


def open_sequence(place: Path, fps: float = DEFAULT_FPS, progress: ProgressFn = no_progress) -> SplatVideo:
    """A folder of splat files (or one file) as a video.

    A new group starts where the number of splats, the SH degree or the order of the splats changes.

    Args:
        place: folder or file; see `find_frames`.
        fps: rate to play at.
        progress: called with files looked at, of all.

    Raises:
        StudioError: no files, or one that is damaged (not all is read here; reading a frame may raise, too).
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
    """First frames of runs in which each splat can be followed from frame to frame.

    Args:
        counts: splats of each frame.
        read: gives a frame.
        progress: called with frames looked at, of all.
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
