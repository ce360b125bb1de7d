"""Synchronization check: offsets between cameras, from sound, motion in the images, or timecodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import av
import cv2
import numpy as np

from v3studio.studio.capture.media import open_media, start_of, video_stream
from v3studio.studio.capture.patterns import VIDEO_EXTENSIONS
from v3studio.studio.capture.timecode import read_timecode, timecode_offsets
from v3studio.studio.counts import counted
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.footage.footage import Footage

SOUND_RATE = 500  # sample rate of the compared loudness signals, in Hz
_MIN_CORRELATION = 0.35  # correlation below which the offset between two cameras is unknown
_MIN_FRAMES = 12
_DOUBT = 2.0  # standard deviations by which the correlation at another offset must be lower
_APART = 0.75  # frames from the best offset within which others may fit as well


@dataclass(frozen=True)
class SyncReport:
    """Offsets between cameras."""

    method: str  # "sound", "motion" or "timecode"
    # camera to lag in frames, including fractions: its frame f + offset was taken at the same time as frame f of the
    # others. The median is 0. Cameras with an unknown offset are not included
    offsets: dict[str, float]
    confidence: dict[str, float]  # camera to its highest correlation with another camera, 0..1; empty with timecodes
    # cameras whose offset is unknown because their signal does not correlate with any other, or because they have no
    # timecode
    unsure: tuple[str, ...]
    # camera to the whole offsets, relative to the camera that it resembles most, that fit about equally well, as on
    # periodic or slow motion. Its offset is not among `offsets`
    several: dict[str, tuple[int, ...]] = field(default_factory=dict)
    # camera to the label at its start, such as 01:00:00:00; empty with other methods
    timecodes: dict[str, str] = field(default_factory=dict)

    @property
    def whole(self) -> dict[str, int]:
        """Offsets rounded to whole frames, without the cameras that round to 0."""
        return {name: round(offset) for name, offset in self.offsets.items() if round(offset)}

    def warnings(self) -> list[Message]:
        """`sync.offset` (fields `camera`, `method`) per late or early camera; `sync.several` and `sync.unknown` per one
        in `several` and `unsure`."""
        messages = []
        for name, offset in self.whole.items():
            frames = counted(abs(offset), "frame")
            what = f"is {frames} {'late' if offset > 0 else 'early'}"
            if self.method == "timecode":  # what comes late in a file was filmed by a camera that started early
                what = f"started {frames} {'earlier' if offset > 0 else 'later'} than the others"
            problem = f"Camera '{name}' {what} according to its {self.method}"
            fix = f"Set capture.offsets to {{{name}: {offset}}}."
            fields = {"camera": name, "method": self.method, "setting": "capture.offsets"}
            messages.append(Message("sync.offset", problem, value=offset, fix=fix, fields=fields))
        for name, fitting in self.several.items():
            problem = (
                f"Camera '{name}': several offsets fit its {self.method}, from {fitting[0]} to {fitting[-1]} frames"
            )
            fix = "Use sound (a clap) or timecodes, film a jump or a flash, or compare a fast moment by eye."
            fields = {"camera": name, "method": self.method}
            messages.append(Message("sync.several", problem, value=list(fitting), fix=fix, fields=fields))
        for name in self.unsure:
            why = f"its {self.method} does not match any other camera"
            if self.method == "timecode":
                why = "it has no timecode"
            problem = f"Camera '{name}': {why}, so its offset is unknown"
            messages.append(Message("sync.unknown", problem, fields={"camera": name, "method": self.method}))
        return messages


@dataclass(frozen=True)
class SignalLags:
    """Result of `offsets_of`, by name: the lag of each signal in samples (the median is 0; NaN if it is not known), its
    highest correlation, 0..1, and of those with an unknown lag but a high correlation the lags that fit."""

    lags: dict[str, float]
    correlation: dict[str, float]
    several: dict[str, list[int]]


def offsets_of(signals: Mapping[str, np.ndarray], most: int, apart: float = _APART) -> SignalLags:
    """The lags of signals from the correlations of all pairs, of which at least 0.35 count, and only if no lag that is
    farther than `apart` samples from the best fits about as well.

    Signals, (N,), are at the same rate and start at the same time if synchronized; `most` is the largest lag to search,
    in samples.
    """
    names = list(signals)
    pairs = []
    best = dict.fromkeys(names, 0.0)
    several: dict[str, list[int]] = {}
    memories = [_autocorrelation(signal) for signal in signals.values()]
    for first, second in combinations(range(len(names)), 2):
        # samples per independent one, in signals that change slowly (Bartlett)
        shared = min(len(memories[first]), len(memories[second]))
        alike = max(1.0, 1 + 2 * float(memories[first][:shared] @ memories[second][:shared]))
        lag, strength, fitting = _lag(signals[names[first]], signals[names[second]], most, alike)
        if strength >= _MIN_CORRELATION and np.abs(fitting - lag).max() <= apart:
            pairs.append((first, second, lag, strength))
        for index, sign in ((first, -1), (second, 1)):
            if strength > best[names[index]]:
                best[names[index]] = strength
                several[names[index]] = sorted(int(sign * other) for other in fitting)
    lags = _solve(len(names), pairs)
    known = [lag for lag in lags if np.isfinite(lag)]
    middle = float(np.median(known)) if known else 0.0
    unknown = [name for name, lag in zip(names, lags, strict=True) if not np.isfinite(lag)]
    return SignalLags(
        {name: float(lag - middle) for name, lag in zip(names, lags, strict=True)},
        best,
        {name: several[name] for name in unknown if best[name] >= _MIN_CORRELATION},
    )


def _lag(a: np.ndarray, b: np.ndarray, most: int, alike: float) -> tuple[float, float, np.ndarray]:
    """The number of samples by which b lags behind a, the Pearson correlation of the overlap at that lag, and the whole
    lags, (M,), whose correlation is not lower by more than chance explains, if one of `alike` samples is independent of
    the others."""
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
    if 0 < best < len(strengths) - 1:  # maximum of the parabola through three values
        before, at, after = strengths[best - 1 : best + 2]
        bend = before - 2 * at + after
        shift = 0.5 * (before - after) / bend if bend < -1e-12 else 0.0
    # chance: Fisher's transform
    independent = (length - abs(best - most)) / alike
    doubt = _DOUBT / np.sqrt(max(independent - 3, 1))
    least = np.tanh(np.arctanh(min(strengths[best], 0.999999)) - doubt)
    fitting = np.flatnonzero(np.array(strengths) >= min(least, strengths[best])) - most
    return best - most + shift, max(0.0, strengths[best]), fitting


def _autocorrelation(signal: np.ndarray) -> np.ndarray:
    """(N // 2,) from lag 1 on."""
    centered = signal.astype(np.float64) - signal.mean()
    spectrum = np.fft.rfft(centered, 2 * len(signal))
    values = np.fft.irfft(np.abs(spectrum) ** 2, 2 * len(signal))[1 : len(signal) // 2 + 1]
    result: np.ndarray = values / max(float(centered @ centered), 1e-12)
    return result


def _solve(count: int, pairs: Sequence[tuple[int, int, float, float]]) -> np.ndarray:
    """(count,) lags from pairwise lags by robust least squares (IRLS); NaN for signals without a pair."""
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
        # pairs only determine differences: the last row sets the sum to 0
        left = np.vstack([rows * weight, np.full((1, len(used)), 1e-6)])
        solution = np.linalg.lstsq(left, np.append(wanted * weight[:, 0], 0), rcond=None)[0]
        trust = 1 / np.maximum(1, np.abs(rows @ solution - wanted))
    lags[used] = solution
    return lags


def check_sync(footage: Footage, *, method: str = "auto", seconds: float = 1.0) -> SyncReport:
    """Estimate the offsets between the cameras of a capture.

    Args:
        footage: opened without offsets.
        method: "sound", "motion", "timecode", or "auto": sound if all cameras have it, otherwise motion. Timecodes are
            only right if the cameras' clocks were set to each other, so they have to be asked for.
        seconds: largest offset to search, in seconds; timecodes have no limit.

    Raises:
        StudioError: `sync.seconds`, `sync.one_camera`, `sync.no_sound` (method "sound"), `sync.too_few_frames`
            (method "motion" needs 12), or with method "timecode" `sync.no_timecode`, `sync.no_overlap`, and those of
            `read_timecode` and `timecode_offsets`.
    """
    if not 0 < seconds < float("inf"):
        fix = "It must be positive and finite; example: 1."
        raise StudioError("sync.seconds", f"The largest offset to search is {seconds:g} s", value=seconds, fix=fix)
    names = footage.camera_names
    if len(names) < 2:
        raise StudioError("sync.one_camera", "The footage has only one camera; there is nothing to synchronize")
    if method == "timecode":
        return _by_timecode(footage)
    sounds = {}
    if method in ("auto", "sound"):
        sounds = {name: signal for name, file in _videos(footage).items() if (signal := sound_signal(file)) is not None}
    if method == "sound" and len(sounds) < len(names):
        silent = next(name for name in names if name not in sounds)
        problem = f"Camera '{silent}' has no sound"
        raise StudioError("sync.no_sound", problem, fix="Use the method motion.", camera=silent)
    if sounds and len(sounds) == len(names):
        frames = footage.fps * footage.spec.frame_range[2] / SOUND_RATE  # per sample
        used, matched = "sound", offsets_of(sounds, round(seconds * SOUND_RATE), _APART / frames)
    else:
        if len(footage.frames) < _MIN_FRAMES:
            problem = f"The footage has {counted(len(footage.frames), 'frame')}; motion needs at least {_MIN_FRAMES}"
            raise StudioError("sync.too_few_frames", problem, value=len(footage.frames), expected=_MIN_FRAMES)
        signals = motion_signals(footage)
        most = min(round(seconds * footage.fps), len(footage.frames) // 3)
        used, frames, matched = "motion", 1.0, offsets_of(signals, most)
    offsets = {name: round(lag * frames, 3) for name, lag in matched.lags.items() if np.isfinite(lag)}
    several = {name: tuple(sorted({round(lag * frames) for lag in lags})) for name, lags in matched.several.items()}
    unsure = tuple(name for name in names if name not in offsets and name not in several)
    correlation = {name: round(value, 3) for name, value in matched.correlation.items()}
    return SyncReport(used, offsets, correlation, unsure, several)


def _by_timecode(footage: Footage) -> SyncReport:
    """Offsets from the start timecodes of the videos."""
    labels = {name: label for name, file in _videos(footage).items() if (label := read_timecode(file)) is not None}
    without = tuple(name for name in footage.camera_names if name not in labels)
    if len(labels) < 2:
        problem = f"{len(labels)} of {len(footage.camera_names)} cameras have a timecode; it takes two to compare"
        fix = "Synchronize by sound or motion."
        raise StudioError("sync.no_timecode", problem, value=len(labels), fix=fix, cameras=without)
    offsets = timecode_offsets(labels)
    frames = {name: footage.frames_of(name) for name in offsets}
    spans = {name: (frames[name][0] - lag, frames[name][-1] - lag) for name, lag in offsets.items()}
    last, first = max(spans, key=lambda name: spans[name][0]), min(spans, key=lambda name: spans[name][1])
    if spans[last][0] > spans[first][1]:
        problem = (
            f"Camera '{first}' ends before camera '{last}' starts ({labels[first].text} and {labels[last].text}), "
            "according to their timecodes"
        )
        fix = "Leave one of them out with capture.cameras, or synchronize by sound or motion."
        raise StudioError("sync.no_overlap", problem, fix=fix, cameras=(first, last))
    lags = {name: float(lag) for name, lag in offsets.items()}
    texts = {name: label.text for name, label in labels.items()}
    return SyncReport("timecode", lags, {}, without, timecodes=texts)


def motion_signals(footage: Footage) -> dict[str, np.ndarray]:
    """Camera to (frames - 1,) square roots of the mean change between consecutive frames in gray levels."""
    signals = {}
    for name in footage.camera_names:
        before, changes = None, []
        for frame in footage.frames:
            image = footage.raw_image(name, frame)
            factor = min(1.0, 240 / max(image.shape[:2]))
            small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            gray = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)
            if before is not None:
                change = np.abs(gray - before)
                # noise and compression change all pixels; their contribution is subtracted
                changes.append(float(np.maximum(change - 2 * np.median(change) - 2, 0).mean()))
            before = gray
        signals[name] = np.sqrt(np.array(changes))
    return signals


def _videos(footage: Footage) -> dict[str, Path]:
    """Camera to the first file of its footage, if that is a video."""
    files = {name: footage.file_of(name, footage.frames_of(name)[0]) for name in footage.camera_names}
    return {name: file for name, file in files.items() if file and file.suffix.lower() in VIDEO_EXTENSIONS}


def sound_signal(file: Path) -> np.ndarray | None:
    """Increase of a video's loudness, (N,) at `SOUND_RATE` from the first video frame on; None without sound."""
    try:
        with open_media(file) as container:
            if not container.streams.audio:
                return None
            video = video_stream(container)
            first = start_of(video) if video is not None else 0.0
            resample = av.AudioResampler(format="flt", layout="mono", rate=16000)
            parts, start = [], None
            for frame in container.decode(audio=0):
                start = frame.time if start is None else start
                parts += [piece.to_ndarray().ravel() for piece in resample.resample(frame)]
    except (av.FFmpegError, OSError) as error:
        raise StudioError("footage.video_unreadable", f"cannot read the sound ({error})", file=file) from None
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
