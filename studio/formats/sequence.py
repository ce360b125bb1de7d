"""Sequences of splat files, one per frame, read and written."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from v3studio.studio.formats import (
    DEFAULT_FPS,
    USD_SUFFIXES,
    Up,
    dropped,
    ignore,
    read_rows,
    splats_size,
    up_of,
    write_splats,
)
from v3studio.studio.formats.checks import Note, check_some_usable, usable
from v3studio.studio.formats.frame_files import CHECKPOINT, find_frames
from v3studio.studio.formats.outliers import Bulk, Spread
from v3studio.studio.formats.placing import new_file, new_folder
from v3studio.studio.formats.rigid_motion import moved, scaled, turned, upright
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.own_frame import frame_sentence, splats_frame
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.similarity import Similarity
from v3studio.studio.splat_video import SplatVideo

_FINE = 0.1  # largest step of positions, in sizes of splats
_SAMPLE = 4000  # number of splats compared to decide whether two frames have the same splats in the same order
# relative to the distance between two random splats: moving splats are far below, shuffled splats near 1
_SAME_ORDER = 0.3


@dataclass(frozen=True)
class Frame:
    """One frame of an import: number of splats and SH degree, and what reads all its rows, noting what is odd."""

    file: Path
    size: tuple[int, int]
    read: Callable[[Note], Gaussians]


def _opened(
    place: Path, fps: float, frames: list[Frame], up: Up, more_notes: Sequence[str | None], progress: ProgressFn
) -> SplatVideo:
    degrees = {frame.size[1] for frame in frames}
    degree = max(degrees)
    notes: dict[str, None] = {}  # in order, each once
    first = frames[0].read(ignore).to(torch.float32)
    check_some_usable(frames[0].file, usable(first))
    spread = Spread.of(first[usable(first)])
    world = splats_frame(spread.middle, spread.radius)
    starts, kept, spreads = _scanned(frames, world, notes, progress)
    bulk = Bulk.of(spreads)

    def read(index: int) -> Gaussians:
        return bulk.pulled_in(moved(frames[index].read(ignore), world)[kept[index]]).with_sh_degree(degree)

    missing = [int((~rows).sum()) for rows in kept]
    for note in (
        dropped(max(missing)) if any(missing) else None,
        frame_sentence(world, "stream", "splats"),
        bulk.note,
        *more_notes,
        f"SH degrees from {min(degrees)} to {degree}: all frames get {degree}" if len(degrees) > 1 else None,
    ):
        if note is not None:
            notes[note] = None
    return SplatVideo(
        str(place), fps, len(frames), starts, read, up=np.array(up), notes=tuple(notes), original=world.inverse
    )


def _gaps(numbers: Sequence[float]) -> str | None:
    """A note on frames that are missing, from their ascending numbers."""
    steps = np.diff(numbers)
    if len(steps) == 0 or steps.min() == steps.max():
        return None
    first = int(np.argmax(steps > steps.min()))
    return (
        f"frames are missing, first between {numbers[first]:g} and {numbers[first + 1]:g}: played without a pause there"
    )


def _coarse(splats: Gaussians) -> str | None:
    """A note on positions so far from zero that their file has too few digits for them."""
    step = float(np.spacing(splats.means.abs().amax(dim=1).median().numpy()))
    if step < _FINE * float(splats.scales.median()):
        return None
    return f"positions are so far from zero that they have steps of {step:g} units: export them near zero for more"


def _scanned(
    frames: list[Frame], world: Similarity, notes: dict[str, None], progress: ProgressFn
) -> tuple[tuple[int, ...], list[np.ndarray], list[Spread]]:
    """First frames of the groups, which rows of each frame to keep, and where its splats are.

    Within a group, the same rows are kept in all frames: those that are usable in each of them.
    """
    usable_rows: list[np.ndarray] = []
    spreads: list[Spread] = []

    def rows() -> Iterable[np.ndarray]:
        for frame in frames:
            stored = frame.read(lambda note: notes.setdefault(note))
            splats = moved(stored, world)
            usable_rows.append(usable(splats))
            check_some_usable(frame.file, usable_rows[-1])
            spreads.append(Spread.of(splats[usable_rows[-1]]))
            coarse = _coarse(stored[usable_rows[-1]])
            if coarse is not None:
                notes.setdefault(coarse)
            yield splats.means.numpy()

    starts = find_groups([frame.size[0] for frame in frames], rows(), progress)
    kept: list[np.ndarray] = []
    for start, end in zip(starts, (*starts[1:], len(frames)), strict=True):
        both = np.logical_and.reduce(usable_rows[start:end])
        check_some_usable(frames[start].file, both)
        kept += [both] * (end - start)
    return starts, kept, spreads


def find_groups(counts: list[int], means: Iterable[np.ndarray], progress: ProgressFn = no_progress) -> tuple[int, ...]:
    """First frames of groups: maximal runs with the same number of splats in the same order, by (N, 3) means."""
    starts: list[int] = []
    before = np.zeros((0, 3))
    generator = np.random.default_rng(0)
    for index, positions in enumerate(means):
        progress(index, len(counts))
        if len(positions) != len(before) or not _same_splats(before, positions, generator):
            starts.append(index)
        before = positions
    progress(len(counts), len(counts))
    return tuple(starts)


def _same_splats(before: np.ndarray, after: np.ndarray, generator: np.random.Generator) -> bool:
    finite = np.flatnonzero(np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1))
    if len(finite) == 0:
        return False
    before, after = before[finite].astype(np.float64), after[finite].astype(np.float64)
    picked = generator.integers(len(before), size=min(_SAMPLE, 4 * len(before)))
    others = generator.integers(len(before), size=len(picked))
    moved = np.median(np.linalg.norm(after[picked] - before[picked], axis=1))
    apart = np.median(np.linalg.norm(after[others] - before[picked], axis=1))
    return bool(moved <= _SAME_ORDER * apart)


def open_import(place: Path | str, fps: float | None = None, progress: ProgressFn = no_progress) -> SplatVideo:
    """Open a USD file, a folder of splat files of one format (see `studio.formats`), or one such file.

    Example:
        >>> splats = v3.trained_video("my-take").read(0)
        >>> v3.write_splats(splats, "frame.ply")
        >>> video = v3.open_import("frame.ply", fps=30)
        >>> video.frame_count, len(video.read(0)) == len(splats)
        (1, True)

    A new group starts where the number or the order of the splats changes. Splats that cannot be rendered in a frame
    are dropped from its whole group; the video's notes say what was ignored, dropped or moved. `fps` None: that of a
    USD file, otherwise `DEFAULT_FPS`, as the others store none. StudioError if the input has none of these formats or
    more than one, or its files are damaged.
    """
    place = Path(place)
    if place.suffix.lower() in USD_SUFFIXES and not place.is_dir():
        from v3studio.studio.formats.usd import UsdFrames

        file = UsdFrames(place)
        frames = [Frame(place, file.size(time), partial(file.read, time)) for time in file.times]
        return _opened(place, fps or file.fps, frames, file.up, [_gaps(file.times)], progress)
    numbered = find_frames(place)
    paths = [path for _, path in numbered]
    last = f"of each model, the last iteration is read: {paths[0].parent.name}" if paths[0].name == CHECKPOINT else None
    frames = [Frame(path, splats_size(path), partial(read_rows, path)) for path in paths]
    notes = [last, _gaps([number for number, _ in numbered])]
    return _opened(place, fps or DEFAULT_FPS, frames, up_of(paths[0]), notes, progress)


def axes_of(video: SplatVideo, format_up: Up, upright_for_viewers: bool) -> np.ndarray | None:
    """The (3, 3) rotation to the `up` of a format, with the side that faces the video's view to the front if it is
    `upright_for_viewers`; None to keep the world axes."""
    if not upright_for_viewers:
        return None
    rotation = upright(video)
    # 3DGS files have y down and z pointing away from the viewer: 180 degrees about x
    return np.diag([1.0, -1.0, -1.0]) @ rotation if format_up[1] < 0 else rotation


def export_sequence(
    video: SplatVideo,
    folder: Path,
    suffix: str,
    rotation: np.ndarray | None = None,
    progress: ProgressFn = no_progress,
    **options: Any,
) -> None:
    """Write `folder/frame_0000.ply`, ..., numbered as in the video, in the world of `video.original`; with a rotation
    of `axes_of`, only its units count: viewers compute in float32.

    The folder must not exist, and appears only when it is complete. `suffix` is of a format in `FRAME_FILES` that is
    written; `options` are those of `write_splats`.
    """
    digits = max(4, len(str(max(video.number(index) for index in range(video.frame_count)))))
    with new_folder(folder) as temporary:
        for index in range(video.frame_count):
            progress(index, video.frame_count)
            path = temporary / f"frame_{video.number(index):0{digits}d}{suffix}"
            _write(video, index, path, rotation, **options)
        progress(video.frame_count, video.frame_count)


def export_frame(video: SplatVideo, path: Path, rotation: np.ndarray | None = None, **options: Any) -> None:
    """Write the first frame to a file, in the format of its extension. Raises StudioError as `export_sequence`."""
    with new_file(path) as temporary:
        _write(video, 0, temporary, rotation, **options)


def _write(video: SplatVideo, index: int, path: Path, rotation: np.ndarray | None, **options: Any) -> None:
    gaussians = scaled(video.read(index), video.original.scale)
    if rotation is not None:
        gaussians = turned(gaussians, rotation)
    elif video.original.translation.any():  # which files for viewers do not have
        options = options | {"offset": video.original.translation}
    write_splats(gaussians, path, **options)
