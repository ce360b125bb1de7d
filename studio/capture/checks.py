"""Reading all footage once and saying what is wrong with it."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from studio.capture.masks import FullMatter
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

if TYPE_CHECKING:
    from studio.capture.footage import Footage

_EMPTY = 2e-5  # of the image: 20 pixels of a megapixel
_FULL = 0.999


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
    """Decode every frame and matte; see `Footage.check`.

    Returns:
        One sentence a problem, those of one kind and camera together.
    """
    frames = footage.frames if frames is None else frames
    total = len(frames) * len(footage.camera_names)
    masked = not isinstance(footage.matter, FullMatter)
    broken: dict[str, list[str]] = defaultdict(list)
    empty: dict[str, list[int]] = defaultdict(list)
    full: dict[str, list[int]] = defaultdict(list)
    done = 0
    for camera in footage.camera_names:
        for frame in frames:
            progress(done, total)
            done += 1
            try:
                footage.raw_image(camera, frame)
                if not masked:
                    continue
                matte = footage.matte(camera, frame)
            except StudioError as error:
                broken[camera].append(str(error))
                if len(broken[camera]) > 3:  # a truncated video would give one sentence for each frame
                    done += len(frames) - frames.index(frame) - 1
                    break
                continue
            share = float((matte >= 128).mean())
            if share < _EMPTY:
                empty[camera].append(frame)
            elif share > _FULL:
                full[camera].append(frame)
    progress(total, total)
    problems: list[str] = []
    for camera in footage.camera_names:
        problems += list(dict.fromkeys(broken[camera]))[:3]
        if empty[camera]:
            problems.append(
                f"Camera '{camera}': the mask is empty in frame {number_ranges(empty[camera])}; mend the masks, or "
                "leave the camera or the frames out."
            )
        if full[camera]:
            problems.append(
                f"Camera '{camera}': the mask is all white in frame {number_ranges(full[camera])}, so nothing is told "
                "apart from the background; mend the masks (white is the performer, black the rest)."
            )
    return problems
