"""Whether cameras show the same instant in the same frame, told from their sound or from what moves in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from studio.capture.footage import Footage
from studio.capture.patterns import VIDEO_EXTENSIONS
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

SOUND_RATE = 500
"""Values a second of the loudness that sounds are compared by."""
_SURE = 0.35
"""Correlation below which two cameras' signals say nothing of their offset."""


@dataclass(frozen=True)
class SyncReport:
    """Offsets between cameras.

    Attributes:
        method: "sound" or "motion".
        offsets: camera to frames that it lags behind: its frame f + offset shows what the others show in frame f. The
            median of all is 0. Fractions of a frame are kept.
        confidence: camera to the best correlation with another camera, 0 to 1.
        unsure: cameras whose signal is like no other's: nothing is known of their offset.
    """

    method: str
    offsets: dict[str, float]
    confidence: dict[str, float]
    unsure: tuple[str, ...]

    @property
    def whole(self) -> dict[str, int]:
        """Offsets in whole frames of the cameras that are late or early by half a frame or more."""
        return {name: round(offset) for name, offset in self.offsets.items() if round(offset)}

    def sentences(self) -> list[str]:
        """What to warn of."""
        found = []
        for name, offset in self.whole.items():
            when = "late" if offset > 0 else "early"
            found.append(
                f"Camera '{name}' is {abs(offset)} frame{'s' if abs(offset) > 1 else ''} {when} by its {self.method}; "
                f"set capture.offsets to {{{name}: {offset}}} to put it right."
            )
        for name in self.unsure:
            found.append(
                f"The {self.method} of camera '{name}' is like no other camera's; its synchronization is unknown."
            )
        return found


def offsets_of(signals: Mapping[str, np.ndarray], most: int) -> tuple[dict[str, float], dict[str, float]]:
    """By how many samples each signal lags, from the correlations of all pairs.

    Args:
        signals: name to (N,) samples of one rate that begin at the same moment, if all is well.
        most: largest lag looked for.

    Returns:
        name to lag (its median over the names is 0) and name to its best correlation. Names whose correlations are all
        under `_SURE` have lag NaN.
    """
    names = list(signals)
    pairs = []
    best = dict.fromkeys(names, 0.0)
    for first, second in combinations(range(len(names)), 2):
        lag, strength = _lag(signals[names[first]], signals[names[second]], most)
        pairs.append((first, second, lag, strength))
        for index in (first, second):
            best[names[index]] = max(best[names[index]], strength)
    sure = [pair for pair in pairs if pair[3] >= _SURE]
    lags = _solve(len(names), sure)
    known = [lag for lag in lags if np.isfinite(lag)]
    middle = float(np.median(known)) if known else 0.0
    return {name: float(lag - middle) for name, lag in zip(names, lags, strict=True)}, best


def _lag(a: np.ndarray, b: np.ndarray, most: int) -> tuple[float, float]:
    """How many samples b lags behind a, and how alike they then are (Pearson, over where they overlap)."""
    length = min(len(a), len(b))
    most = min(most, length // 2)
    strengths = []
    for lag in range(-most, most + 1):
        left = a[max(0, -lag) : length - max(0, lag)]
        right = b[max(0, lag) : length - max(0, -lag)]
        left, right = left - left.mean(), right - right.mean()
        scale = float(np.sqrt((left * left).sum() * (right * right).sum()))
        strengths.append(float((left * right).sum()) / scale if scale > 1e-12 else 0.0)
    best = int(np.argmax(strengths))
    shift = 0.0
    if 0 < best < len(strengths) - 1:  # the top of the parabola through three values
        before, at, after = strengths[best - 1 : best + 2]
        bend = before - 2 * at + after
        shift = 0.5 * (before - after) / bend if bend < -1e-12 else 0.0
    return best - most + shift, max(0.0, strengths[best])


def _solve(count: int, pairs: Sequence[tuple[int, int, float, float]]) -> np.ndarray:
    """Lags (count,) that agree best with those of pairs, pairs that disagree weighing less and less; NaN alone."""
    lags = np.full(count, np.nan)
    used = sorted({index for pair in pairs for index in pair[:2]})
    if not used:
        return lags
    place = {index: row for row, index in enumerate(used)}
    weights = np.array([strength for *_, strength in pairs])
    rows = np.zeros((len(pairs), len(used)))
    wanted = np.array([lag for _, _, lag, _ in pairs])
    for row, (first, second, _, _) in enumerate(pairs):
        rows[row, place[first]], rows[row, place[second]] = -1, 1
    trust = np.ones(len(pairs))
    for _ in range(10):
        weight = (weights * trust)[:, None]
        # the last row fixes what pairs leave open: the sum is 0
        left = np.vstack([rows * weight, np.full((1, len(used)), 1e-6)])
        found = np.linalg.lstsq(left, np.append(wanted * weight[:, 0], 0), rcond=None)[0]
        trust = 1 / np.maximum(1, np.abs(rows @ found - wanted))
    lags[used] = found
    return lags


def check_sync(
    footage: Footage,
    *,
    method: str = "auto",
    seconds: float = 1.0,
    progress: ProgressFn = no_progress,
) -> SyncReport:
    """Estimate the offsets between the cameras of a capture.

    Args:
        footage: opened without offsets.
        method: "sound" (all videos have it), "motion", or "auto": sound where all have it.
        seconds: largest offset looked for.
        progress: called for every camera and, by motion, every frame.

    Raises:
        StudioError: seconds that cannot be, fewer than two cameras, too few frames, or no sound where it was asked for.
    """
    if not 0 < seconds < float("inf"):
        raise StudioError(f"Offsets of up to {seconds:g} s cannot be looked for; give seconds above 0, as in 1.")
    names = footage.camera_names
    if len(names) < 2:
        raise StudioError("Synchronization is between cameras; there is only one.")
    sounds = _sounds(footage) if method in ("auto", "sound") else {}
    if method == "sound" and len(sounds) < len(names):
        silent = next(name for name in names if name not in sounds)
        raise StudioError(f"Camera '{silent}' has no sound; check the synchronization by motion.")
    if sounds and len(sounds) == len(names):
        lags, best = offsets_of(sounds, round(seconds * SOUND_RATE))
        lags = {name: lag / SOUND_RATE * footage.fps for name, lag in lags.items()}
        used = "sound"
    else:
        if len(footage.frames) < 12:
            raise StudioError(f"Motion tells offsets from 12 frames or more; the footage has {len(footage.frames)}.")
        signals = motion_signals(footage, progress)
        lags, best = offsets_of(signals, min(round(seconds * footage.fps), len(footage.frames) // 3))
        used = "motion"
    unsure = tuple(name for name in names if not np.isfinite(lags[name]))
    return SyncReport(
        used,
        {name: round(lag, 3) for name, lag in lags.items() if np.isfinite(lag)},
        {name: round(value, 3) for name, value in best.items()},
        unsure,
    )


def motion_signals(footage: Footage, progress: ProgressFn = no_progress) -> dict[str, np.ndarray]:
    """Of each camera how much changes from frame to frame: (frames - 1,), in gray levels of a small picture."""
    import cv2

    found = {}
    total = len(footage.camera_names) * len(footage.frames)
    for number, name in enumerate(footage.camera_names):
        before, values = None, []
        for index, frame in enumerate(footage.frames):
            progress(number * len(footage.frames) + index, total)
            image = footage.raw_image(name, frame)
            factor = min(1.0, 240 / max(image.shape[:2]))
            small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)
            if before is not None:
                change = np.abs(gray - before)
                # what sensors and encoders change everywhere is no motion
                values.append(float(np.maximum(change - 2 * np.median(change) - 2, 0).mean()))
            before = gray
        found[name] = np.sqrt(np.array(values))
    return found


def _sounds(footage: Footage) -> dict[str, np.ndarray]:
    found = {}
    for name in footage.camera_names:
        file = footage.file_of(name, footage.frames[0])
        if file is None or file.suffix.lower() not in VIDEO_EXTENSIONS:
            continue
        loudness = sound_signal(file)
        if loudness is not None:
            found[name] = loudness
    return found


def sound_signal(file: Path) -> np.ndarray | None:
    """How the loudness of a video rises, `SOUND_RATE` values a second from its first picture on; None without sound.

    Raises:
        StudioError: the file cannot be read.
    """
    import av

    try:
        with av.open(str(file)) as container:
            if not container.streams.audio:
                return None
            picture: Any = container.streams.video[0]
            first = float(picture.start_time * picture.time_base) if picture.start_time is not None else 0.0
            resample = av.AudioResampler(format="flt", layout="mono", rate=16000)
            parts, start = [], None
            for frame in container.decode(audio=0):
                start = frame.time if start is None else start
                parts += [piece.to_ndarray().ravel() for piece in resample.resample(frame)]
    except (av.FFmpegError, OSError) as error:
        raise StudioError(f"{file}: its sound cannot be read ({error}).") from None
    if not parts:
        return None
    samples = np.concatenate(parts)
    skip = round((first - (start or 0.0)) * 16000)
    samples = samples[skip:] if skip > 0 else np.concatenate([np.zeros(-skip, np.float32), samples])
    window = 16000 // SOUND_RATE
    energy = (samples[: len(samples) // window * window].reshape(-1, window) ** 2).mean(1)
    if energy.max() < 1e-12:
        return None
    loudness = np.log(energy + 1e-4 * energy.max())
    return np.maximum(np.diff(loudness, prepend=loudness[:1]), 0)
