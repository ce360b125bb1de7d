"""Reading all footage once and saying what is wrong with it."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from studio.capture.footage import Footage
from studio.capture.mattes.matte_source import FullMatteSource
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

_EMPTY = 2e-5  # of the image: 20 pixels of a megapixel
_FULL = 0.999
_READERS = 4  # cameras that are read side by side, where there are so many cores


@dataclass
class _Found:
    """What is wrong with one camera's frames: sentences, and frames with such masks."""

    broken: list[str] = field(default_factory=list)
    empty: list[int] = field(default_factory=list)
    full: list[int] = field(default_factory=list)


def number_ranges(numbers: list[int]) -> str:
    """'3, 7-9 and 12' style list of frame numbers, shortened to the first few ranges."""
    runs: list[tuple[int, int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], number)
        else:
            runs.append((number, number))
    texts = [str(first) if first == last else f"{first}-{last}" for first, last in runs]
    if len(texts) > 6:
        return f"{', '.join(texts[:6])} and more ({len(numbers)} in all)"
    return ", ".join(texts)


def check_footage(
    footage: Footage, progress: ProgressFn = no_progress, frames: tuple[int, ...] | None = None
) -> list[str]:
    """Decode every frame and matte, several cameras side by side; and tell what is wrong.

    Args:
        footage: what is read.
        progress: called with images read, of all.
        frames: only these; None is all.

    Returns:
        An empty list where the footage is sound; else `Footage.problems`, and then
        One sentence a problem, those of one kind and camera together.
    """
    frames = footage.frames if frames is None else frames
    total = len(frames) * len(footage.camera_names)
    masked = not isinstance(footage.matte_source, FullMatteSource)
    lock, stop = threading.Lock(), threading.Event()
    done = 0

    def tell(count: int) -> None:
        nonlocal done
        with lock:  # a `progress` need not be thread safe
            if not stop.is_set():
                progress(done, total)
            done += count

    def look(camera: str) -> _Found:
        found = _Found()
        for position, frame in enumerate(frames):
            if stop.is_set():
                break
            tell(1)
            try:
                footage.image(camera, frame)  # as training will ask for it, so that short takes are kept
                if not masked:
                    continue
                matte = footage.matte(camera, frame)
            except StudioError as error:
                found.broken.append(str(error))
                if len(found.broken) > 3:  # a truncated video would give one sentence for each frame
                    tell(len(frames) - position - 1)
                    break
                continue
            share = float((matte >= 128).mean())
            if share < _EMPTY:
                found.empty.append(frame)
            elif share > _FULL:
                found.full.append(frame)
        return found

    with ThreadPoolExecutor(min(_READERS, len(os.sched_getaffinity(0))), thread_name_prefix="check") as readers:
        try:
            looks = [readers.submit(look, camera) for camera in footage.camera_names]
            results = [one.result() for one in looks]
        except BaseException:
            stop.set()
            raise
    progress(total, total)
    problems = list(footage.problems)
    for camera, found in zip(footage.camera_names, results, strict=True):
        problems += list(dict.fromkeys(found.broken))[:3]
        if found.empty:
            problems.append(
                f"Camera '{camera}': the mask is empty in frame {number_ranges(found.empty)}; mend the masks, or "
                "leave the camera or the frames out."
            )
        if found.full:
            problems.append(
                f"Camera '{camera}': the mask is all white in frame {number_ranges(found.full)}, so nothing is told "
                "apart from the background; mend the masks (white is the performer, black the rest)."
            )
    return problems
