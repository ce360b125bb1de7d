"""Measures time, cameras, masks and color of footage on a few frames, and grades each."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from v3studio.studio.calibration.epipolar import PairMatches, match_images
from v3studio.studio.calibration.outlines import Outlines
from v3studio.studio.calibration.report import RigVerdict
from v3studio.studio.calibration.verdict import judge
from v3studio.studio.cameras import Camera
from v3studio.studio.card.colors import DIFFERENCES, LEAST_POINTS, ColorDifference, color_differences
from v3studio.studio.card.grades import Card, Check, Grade
from v3studio.studio.card.mask_checks import SHIFTS, shift_scores, uncovered
from v3studio.studio.card.sample import Sample, read_sample
from v3studio.studio.card.timing import Lag, lags
from v3studio.studio.counts import cameras_listed, counted, listed
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import Footage
from v3studio.studio.footage.sync import check_sync
from v3studio.studio.progress import ProgressFn, no_progress, part_of
from v3studio.studio.yaml_text import inline_yaml

_UNKNOWN: Grade = "not enough to judge"

_LATE, _LATE_HERE = 0.2, 0.8
"""Frames by which a camera is out of time, in all frames and in one window; synchronized ones: up to 0.1 and 0.45."""
_SOUND = 0.5  # frames: sound is late by as much over 3 m at 60 fps, so that only more tells
_MOST_NAMED = 6  # cameras that a line names
_SHIFTED = 1.15  # a mask's frame is another one if images change so many times as much where those masks change
_OUTSIDE = 0.12  # share of what moves that is outside of masks, from which on something is missing: at most 0.01 if not
_FAR_COLORS = 30.0  # levels
_INVERTED = 0.8  # share of the images' borders in masks that are inverted
_TANGENTS, _AGREE, _SELDOM = 24, 0.5, 0.5
"""Tangents that can judge; share of them that agree in masks that are right (0.7 to 1.0); share of what is usual below
which a camera is named."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A card and what it was measured on, to draw it."""

    card: Card
    sample: Sample
    cameras: Mapping[str, Camera]
    pairs: list[PairMatches]


def measure(
    footage: Footage, progress: ProgressFn = no_progress, sample: Sample | None = None, computed: bool = True
) -> Measured:
    """Measure the card of footage, opened with its cameras or without them. `sample`, `computed`: what was read of it
    already, else see `read_sample`. StudioError: an image cannot be read."""
    sample = sample or read_sample(footage, part_of(progress, 0, 60), computed)
    pairs = match_images(sample.images, progress=part_of(progress, 60, 90))
    cameras = {camera.name: camera for camera in footage.rig} if footage.is_calibrated else {}
    progress(95, 100)
    return measure_sample(sample, cameras, pairs, partial(_lags_of_sound, footage))


def measure_sample(
    sample: Sample,
    cameras: dict[str, Camera],
    pairs: list[PairMatches],
    of_sound: Callable[[], dict[str, list[Lag]]] = dict,
) -> Measured:
    """Measure the card of frames that were read; `cameras`, of full-size images, may be empty. `of_sound`: lags, asked
    for if the masks do not tell."""
    cameras = {name: cameras[name].resized(*image.shape[1::-1]) for name, image in sample.images.items() if cameras}
    ends, outlines = sample.outlines(every=False), sample.outlines()
    verdict = judge(cameras, pairs, None, outlines=ends) if cameras else None
    fits = verdict is not None and verdict.grade != "wrong"
    late = lags(outlines, cameras, sample.runs, sample.windows) if outlines is not None and fits else {}
    time = _time(late, fits)
    if time.grade == _UNKNOWN and (heard := of_sound()):
        late, time = heard, _time(heard, fits, "By their sound: ")
    checks = (
        time,
        _cameras(verdict),
        _masks(sample, cameras if fits else {}, ends),
        _color(color_differences(sample.images, pairs)),
    )
    known = {name: round(each[0].frames, 2) for name, each in late.items() if each[0].known}
    return Measured(Card(checks=checks, late=known, frames=sample.frames), sample, cameras, pairs)


def _lags_of_sound(footage: Footage) -> dict[str, list[Lag]]:
    """Frames by which cameras are late besides `capture.offsets`, by sound, if all have it and it tells."""
    try:
        report = check_sync(footage, method="sound")
    except StudioError:  # some have no sound, or it cannot be read
        return {}
    late = {name: offset - footage.spec.offsets.get(name, 0) for name, offset in report.offsets.items()}
    middle = float(np.median(list(late.values()))) if late else 0.0
    return {name: [Lag(each - middle, len(late) - 1, _SOUND)] for name, each in late.items()}


def _time(late: Mapping[str, list[Lag]], fits: bool, source: str = "") -> Check:
    known = {name: each for name, each in late.items() if each[0].known}
    if len(known) < 2 or len(known) < len(late) / 2:
        why = "little moves in the masks" if fits else "the cameras are not known, or do not fit"
        return Check(
            name="time", grade=_UNKNOWN, words=f"Not compared, since {why}.", fix="`v3studio sync` compares motion."
        )
    varying = {name: change for name, each in known.items() if (change := _change(each[1:])) is not None}
    offset = {
        name: each[0].frames
        for name, each in known.items()
        if name not in varying and abs(each[0].frames) > (_LATE if each[0].spread <= _LATE else 3 * _LATE)
    }
    words, fix = [source.strip()] if source and offset else [], []
    for name, (before, after) in list(varying.items())[:_MOST_NAMED]:
        words.append(f"{name} is {before:+.1f} frames late, then {after:+.1f}: it drops frames, or its rate varies.")
    if varying:
        fix.append("Film with a constant rate, or convert it to the others' by its timestamps.")
    if offset:
        named = sorted(offset, key=lambda name: -abs(offset[name]))[:_MOST_NAMED]
        words.append(f"Late by frames: {', '.join(f'{name} {offset[name]:+.2f}' for name in named)}.")
        whole = {name: round(offset[name]) for name in named if round(offset[name])}
        fix.append(f"Set capture.offsets to {inline_yaml(whole)}." if whole else "Synchronize the cameras (genlock).")
    if words:
        causes = (*(["rate"] if varying else []), *(["late"] if offset else []))
        some = max(map(abs, offset.values()), default=1.0)
        grade: Grade = "wrong" if varying or some >= 0.25 else "doubtful"
        return Check(
            name="time", grade=grade, words=" ".join(words), fix=" ".join(fix), causes=causes,
            cameras=(*varying, *offset),
        )  # fmt: skip
    worst = max(abs(each[0].frames) for each in known.values())
    return Check(name="time", grade="good", words=f"{source}{counted(len(known), 'camera')} within {worst:.2f} frames.")


def _change(windows: list[Lag]) -> tuple[float, float] | None:
    """The first and the last lag, if they are known and differ."""
    clear = [lag for lag in windows if lag.known and lag.spread < _LATE_HERE / 2]
    if len(clear) < 2 or abs(clear[-1].frames - clear[0].frames) < _LATE_HERE:
        return None
    return clear[0].frames, clear[-1].frames


def _cameras(verdict: RigVerdict | None) -> Check:
    if verdict is None:
        words = "The footage has no camera file that fits it."
        return Check(name="cameras", grade=_UNKNOWN, words=words, fix="Calibrate estimates the cameras.")
    doubtful: Grade = "doubtful" if verdict.blamed else _UNKNOWN
    grades: dict[str, Grade] = {"good": "good", "usable": doubtful, "wrong": "wrong"}
    return Check(
        name="cameras",
        grade=grades[verdict.grade],
        words=verdict.reason,
        fix=verdict.fix,
        causes=(verdict.cause,) if verdict.cause else (),
        cameras=verdict.doubtful,
    )


def _masks(sample: Sample, cameras: Mapping[str, Camera], outlines: Outlines | None) -> Check:
    def check(grade: Grade, words: str, fix: str = "", cause: str = "", off: tuple[str, ...] = ()) -> Check:
        return Check(name="masks", grade=grade, words=words, fix=fix, causes=(cause,) if cause else (), cameras=off)

    if outlines is None:
        return check(_UNKNOWN, "The footage has no masks that can be compared.")
    inside = float(np.median([_on_border(stack) for stack in sample.masks.values()]))
    if inside > _INVERTED:
        words = f"Inverted: they hold {inside:.0%} of the images' borders, but not what is within."
        return check("wrong", words, "Invert the masks: white is the performer.", "inverted")
    scores = {
        name: scores
        for name, stack in sample.masks.items()
        if (scores := shift_scores(sample.small[name], stack, sample.windows)) is not None
    }
    shifted = {name: SHIFTS[int(each.argmax())] for name, each in scores.items() if each.max() > _SHIFTED * each[2]}
    moved = {name: by for name, by in shifted.items() if by}
    if moved and len(moved) > len(scores) / 2:
        by = int(np.median(list(moved.values())))
        which = f"{abs(by)} {'later' if by > 0 else 'earlier'}"
        words = f"They are of other frames: those {which} fit, in {counted(len(moved), 'camera')}."
        return check("wrong", words, "Number masks and images from the same frame.", "frames", tuple(moved))
    pixels = {name: uncovered(sample.small[name], stack, sample.windows) for name, stack in sample.masks.items()}
    changed, outside = np.sum(list(pixels.values()), 0)
    missing = [name for name, (all_of, some) in pixels.items() if all_of and some > _OUTSIDE * all_of]
    if missing and len(missing) > len(pixels) / 3:
        words = f"{outside / changed:.0%} of what moves is outside of them: they may be of one of several objects."
        return check("wrong", words, "Join the masks of all objects.", "object", tuple(missing))
    same, tangents, poor = _agreement(cameras, outlines)
    off = dict.fromkeys([*moved, *missing, *poor])
    if off:
        named = cameras_listed(list(off)[:_MOST_NAMED], "Camera")
        words = f"{named}: masks that do not fit the images or the other cameras."
        return check("doubtful", words, "Look at these masks.", "cameras", tuple(off))
    if tangents < _TANGENTS or not changed:
        what = "the cameras cannot be compared" if tangents < _TANGENTS else "little moves"
        return check(_UNKNOWN, f"Not all can be measured, since {what}.")
    if same < _AGREE * tangents:
        words = f"Only {same / tangents:.0%} of the planes that touch them in one camera touch them in others."
        return check("doubtful", words, "Look at the masks.", "disagree")
    moves = f"{outside / changed:.0%} of what moves is outside"
    return check("good", f"{same / tangents:.0%} of their tangents agree between cameras; {moves}.")


def _agreement(cameras: Mapping[str, Camera], outlines: Outlines) -> tuple[int, int, list[str]]:
    """Tangents that agree between cameras, all of them, and the cameras whose tangents seldom do."""
    if not cameras:
        return 0, 0, []
    counts = outlines.moved().fitting(cameras)
    shares = {}
    for name in outlines.hulls:
        own = np.sum([each for pair, each in counts.items() if name in pair] or [(0, 0)], 0)
        if own[1] >= _TANGENTS:
            shares[name] = own[0] / own[1]
    usual = float(np.median(list(shares.values()))) if shares else 0.0
    same, tangents = np.sum(list(counts.values()) or [(0, 0)], 0)
    return int(same), int(tangents), [name for name, share in shares.items() if share < _SELDOM * usual]


def _on_border(masks: np.ndarray) -> float:
    """The share of the images' border in masks (N, h, w) that are neither empty nor full."""
    inside = masks > 127
    border = np.concatenate([inside[:, 0], inside[:, -1], inside[:, :, 0], inside[:, :, -1]], 1)
    return float(border.mean()) if 0.001 < inside.mean() < 0.999 else 0.0


def _color(differences: Mapping[str, ColorDifference]) -> Check:
    enough = {name: each for name, each in differences.items() if each.points >= LEAST_POINTS}
    if len(enough) < 2:
        return Check(name="color", grade=_UNKNOWN, words="The images have too few points in common to compare colors.")
    explained = {name: each for name, each in enough.items() if each.kind}
    far = [name for name, each in enough.items() if each.levels > _FAR_COLORS and not each.kind]
    if explained or far:
        words = [f"{name} {DIFFERENCES[each.kind][0]}." for name, each in list(explained.items())[:_MOST_NAMED]]
        words += [f"{listed(far[:_MOST_NAMED])}: more than {_FAR_COLORS:.0f} levels from the others."] if far else []
        fix = "Tag the video, set capture.color_matrix or capture.transfer, or train with train.camera_colors."
        causes = tuple(dict.fromkeys(each.kind.partition(" ")[0] for each in explained.values()))
        return Check(
            name="color", grade="wrong" if explained else "doubtful", words=" ".join(words), fix=fix, causes=causes,
            cameras=(*explained, *far),
        )  # fmt: skip
    worst = max(each.levels for each in enough.values())
    return Check(
        name="color", grade="good", words=f"{counted(len(enough), 'camera')} within {worst:.0f} levels of 255."
    )
