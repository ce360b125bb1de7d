"""Check of a whole capture: decode each frame and mask once and report problems."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from studio.capture.color_drift import ColorDrift
from studio.capture.footage import Footage
from studio.capture.frame_numbers import number_ranges
from studio.counts import plural
from studio.errors import Message, StudioError
from studio.masks.mask_source import FullMaskSource, MissingMaskSource
from studio.progress import ProgressFn, no_progress

_EMPTY = 2e-5  # fraction of the image: 20 pixels per megapixel
_FULL = 0.999
_READERS = 4  # cameras that are decoded in parallel, if there are enough cores
_MOST_ERRORS = 3  # reported per camera


@dataclass
class _CameraProblems:
    """Errors of one camera, and frame numbers with an empty or a full mask."""

    errors: list[Message] = field(default_factory=list)
    empty: list[int] = field(default_factory=list)
    full: list[int] = field(default_factory=list)


def check_footage(
    footage: Footage,
    progress: ProgressFn = no_progress,
    frames: tuple[int, ...] | None = None,
    drift: ColorDrift | None = None,
) -> list[Message]:
    """Decode all frames and masks, several cameras in parallel, and report problems.

    Args:
        footage: the capture to check.
        progress: called with the number of images decoded and their total; may raise `Cancelled`.
        frames: frame numbers to check; None checks all.
        drift: sees the frames of cameras with masks, for its own messages.

    Returns:
        `Footage.problems`, then for each camera up to three errors (with the codes of `Footage.image` and
        `Footage.mask`) and at most one `mask.empty` and one `mask.full` with the fields `camera` and `frames`.
        Empty if no problems are found.
    """
    frames = footage.frames if frames is None else frames
    total = len(frames) * len(footage.camera_names)
    missing = footage.mask_source if isinstance(footage.mask_source, MissingMaskSource) else None
    masked = missing is None and not isinstance(footage.mask_source, FullMaskSource)
    lock, stop = threading.Lock(), threading.Event()
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        with lock:  # `progress` need not be thread safe
            if not stop.is_set():
                progress(done, total)
            done += count

    def check_camera(camera: str) -> _CameraProblems:
        found = _CameraProblems()
        for position, frame in enumerate(frames):
            if stop.is_set():
                break
            advance(1)
            try:
                image = footage.image(camera, frame)  # also fills the cache for training if the capture fits into it
                if not masked:
                    continue
                mask = footage.mask(camera, frame)
            except StudioError as error:
                found.errors.append(error.message)
                if len(found.errors) > _MOST_ERRORS:  # a truncated video gives one error per frame
                    advance(len(frames) - position - 1)
                    break
                continue
            if drift is not None:
                drift.see(camera, frame, image, mask)
            share = float((mask >= 128).mean())
            if share < _EMPTY:
                found.empty.append(frame)
            elif share > _FULL:
                found.full.append(frame)
        return found

    with ThreadPoolExecutor(min(_READERS, len(os.sched_getaffinity(0))), thread_name_prefix="check") as readers:
        try:
            tasks = [readers.submit(check_camera, camera) for camera in footage.camera_names]
            results = [task.result() for task in tasks]
        except BaseException:
            stop.set()
            raise
    progress(total, total)
    problems = [*footage.problems, *([missing.message] if missing is not None else [])]
    for camera, found in zip(footage.camera_names, results, strict=True):
        problems += list({str(message): message for message in found.errors}.values())[:_MOST_ERRORS]
        if found.empty:
            problems.append(
                Message(
                    "mask.empty",
                    f"Camera '{camera}': the mask is empty in {_frames(found.empty)}",
                    fix="Fix the masks, or exclude the camera or the frames.",
                    fields={"camera": camera, "frames": tuple(found.empty)},
                )
            )
        if found.full:
            problems.append(
                Message(
                    "mask.full",
                    f"Camera '{camera}': the mask covers the whole image in {_frames(found.full)}",
                    fix="Fix the masks: white is the performer, black the background.",
                    fields={"camera": camera, "frames": tuple(found.full)},
                )
            )
    return problems


def _frames(numbers: list[int]) -> str:
    return f"{plural('frame', len(numbers))} {number_ranges(numbers)}"
