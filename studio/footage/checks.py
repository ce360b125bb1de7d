"""Check of a whole capture: decode each frame and mask once and report problems, and colors that change."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from v3studio.studio.capture.patterns import number_ranges
from v3studio.studio.counts import plural
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.footage.footage import Footage
from v3studio.studio.masks.mask_source import FullMaskSource, MissingMaskSource
from v3studio.studio.progress import ProgressFn, no_progress

_LARGEST_DRIFT = 0.03  # change of a color channel that is reported, relative to its median over time

_STEP = 4  # every fourth row and column is enough
_LEAST_PIXELS = 200
_BEYOND = 0.01  # fraction of the performer beyond the view of a fisheye that is reported
_DARK, _BRIGHT = 24, 232  # beyond, noise or clipping hides the gain; backgrounds that were cut out are 0 or 255


class ColorDrift:
    """Compares the set around the performer, frame by frame, with the first frame of each camera.

    The gain of a channel is the median over pixels, so that shadows and things that move do not count. Performers
    beyond the view of a fisheye are noticed, too. `see` may be called by several threads with different cameras.
    """

    def __init__(self) -> None:
        self._first: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._gains: dict[str, dict[int, np.ndarray]] = {}
        self._beyond: dict[str, dict[int, float]] = {}

    def see(self, camera: str, frame: int, image: np.ndarray, mask: np.ndarray, beyond: float = 0.0) -> None:
        """Measure a frame: an image (H, W, 3) uint8 RGB, a mask (H, W) uint8, in which 255 is the performer, and
        `Footage.beyond_view`."""
        if beyond > _BEYOND:
            self._beyond.setdefault(camera, {})[frame] = beyond
        colors, around = image[::_STEP, ::_STEP].astype(np.float32), mask[::_STEP, ::_STEP] < 8
        if camera not in self._first:
            self._first[camera] = (colors, around)
            self._gains[camera] = {}
        first, first_around = self._first[camera]
        if colors.shape != first.shape:
            return
        usable = around & first_around
        for each in (colors, first):
            usable &= (each > _DARK).all(-1) & (each < _BRIGHT).all(-1)
        if usable.sum() >= _LEAST_PIXELS:
            self._gains[camera][frame] = np.median(colors[usable] / first[usable], axis=0)

    def messages(self) -> list[Message]:
        """A warning `footage.color_drift` for each camera whose colors change, with the fields `camera`, `frames` and
        `change` (largest change of a channel, 0.05 is 5%), and `mask.beyond_view` for each whose performer is not
        wholly in the view of its fisheye, with `camera`, `frames` and `value`, the largest fraction that is beyond."""
        warnings = []
        for camera, shares in sorted(self._beyond.items()):
            share = max(shares.values())
            told = f"up to {share:.0%} of the performer is beyond the view in {_frames(list(shares))}"
            fix = "Of a fisheye, 60 degrees to each side are used: turn the camera, or leave it out (capture.cameras)."
            warnings.append(
                Message(
                    "mask.beyond_view",
                    f"Camera '{camera}': {told}",
                    value=round(share, 3),
                    fix=fix,
                    fields={"camera": camera, "frames": tuple(shares)},
                )
            )
        for camera, gains in sorted(self._gains.items()):
            if len(gains) < 3:
                continue
            frames, measured = list(gains), np.stack(list(gains.values()))
            change = np.abs(measured / np.median(measured, axis=0) - 1)
            if change.max() <= _LARGEST_DRIFT:
                continue
            far = [frame for frame, largest in zip(frames, change.max(1), strict=True) if largest > _LARGEST_DRIFT]
            spread = change.max(0)
            together = np.ptp(measured / np.median(measured, axis=0), axis=1).max() < _LARGEST_DRIFT
            what = "brightness" if together else "color"
            channel = ("red", "green", "blue")[int(spread.argmax())]
            amount = f"up to {100 * change.max():.0f}%" + ("" if together else f" in {channel}")
            problem = f"Camera '{camera}': the {what} of the set changes by {amount} in frames {number_ranges(far)}"
            fix = "Film with manual exposure and white balance; splats would flicker with it."
            fields = {"camera": camera, "frames": tuple(far), "change": round(float(change.max()), 4)}
            warnings.append(Message("footage.color_drift", problem, fix=fix, fields=fields))
        return warnings


_EMPTY = 2e-5  # fraction of the image: 20 pixels per megapixel
_FULL = 0.999
_READERS = 4  # cameras that are decoded in parallel, if there are enough cores
_MOST_ERRORS = 3  # reported per camera


@dataclass
class _CameraProblems:
    """Errors of one camera, frame numbers with an empty or a full mask, and the highest value in the empty ones."""

    errors: list[Message] = field(default_factory=list)
    empty: list[int] = field(default_factory=list)
    highest: int = 0
    full: list[int] = field(default_factory=list)


def check_footage(
    footage: Footage,
    progress: ProgressFn = no_progress,
    frames: tuple[int, ...] | None = None,
    drift: ColorDrift | None = None,
    see: Callable[[str, int, np.ndarray, np.ndarray | None], object] = lambda *seen: None,
) -> list[Message]:
    """Decode all frames (or those of the given numbers) and masks, several cameras in parallel, and report problems.

    Args:
        progress: called with the number of images decoded and their total; may raise `Cancelled`.
        drift: sees the frames of cameras with masks, for its own messages.
        see: called with camera, frame, image and mask, None without one; on several threads, but one for each camera.

    Returns:
        `Footage.problems`, then for each camera up to three errors (with the codes of `Footage.image` and
        `Footage.mask`) and at most one `mask.empty` and one `mask.full` with the fields `camera` and `frames`.
    """
    frames = footage.frames if frames is None else frames
    total = len(frames) * len(footage.camera_names)
    missing = footage.mask_source if isinstance(footage.mask_source, MissingMaskSource) else None
    masked = missing is None and not isinstance(footage.mask_source, FullMaskSource)
    unmasked = footage.unmasked_cameras
    lock, stop = threading.Lock(), threading.Event()
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        with lock:  # `progress` need not be thread safe
            if not stop.is_set():
                progress(done, total)
            done += count

    def check_camera(camera: str) -> _CameraProblems:
        own = _CameraProblems()
        for position, frame in enumerate(frames):
            if stop.is_set():
                break
            advance(1)
            try:
                image = footage.image(camera, frame)  # also fills the cache for training if the capture fits into it
                if not masked or camera in unmasked:
                    see(camera, frame, image, None)
                    continue
                # first, since `mask` lets go of the raw mask
                beyond = footage.beyond_view(camera, frame) if drift is not None else 0.0
                mask = footage.mask(camera, frame)
            except StudioError as error:
                own.errors.append(error.message)
                if len(own.errors) > _MOST_ERRORS:  # a truncated video gives one error per frame
                    advance(len(frames) - position - 1)
                    break
                continue
            see(camera, frame, image, mask)
            if drift is not None:
                drift.see(camera, frame, image, mask, beyond)
            share = float((mask >= 128).mean())
            if share < _EMPTY:
                own.empty.append(frame)
                own.highest = max(own.highest, int(mask.max()))
            elif share > _FULL:
                own.full.append(frame)
        return own

    with ThreadPoolExecutor(min(_READERS, len(os.sched_getaffinity(0))), thread_name_prefix="check") as readers:
        try:
            tasks = [readers.submit(check_camera, camera) for camera in footage.camera_names]
            results = [task.result() for task in tasks]
        except BaseException:
            stop.set()
            raise
    progress(total, total)
    problems = [*footage.problems, *([missing.message] if missing is not None else [])]
    for camera, own in zip(footage.camera_names, results, strict=True):
        problems += list({str(message): message for message in own.errors}.values())[:_MOST_ERRORS]
        if own.empty:
            problem = f"Camera '{camera}': the mask is empty in {_frames(own.empty)}" + (
                f" (its highest value there is {own.highest} of 255)" if own.highest else ""
            )
            fix = "Fix the masks, or exclude the camera or the frames."
            problems.append(
                Message("mask.empty", problem, fix=fix, fields={"camera": camera, "frames": tuple(own.empty)})
            )
        if own.full:
            problem = f"Camera '{camera}': the mask covers the whole image in {_frames(own.full)}"
            fix = "Fix the masks: white is the performer, black the background."
            problems.append(
                Message("mask.full", problem, fix=fix, fields={"camera": camera, "frames": tuple(own.full)})
            )
    return problems


def _frames(numbers: list[int]) -> str:
    return f"{plural('frame', len(numbers))} {number_ranges(numbers)}"
