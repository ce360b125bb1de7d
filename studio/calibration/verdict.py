"""Judges whether a rig is right, by what it was not made from: matches between images, and the performer's masks."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from v3studio.studio.calibration.epipolar import LEAST_MATCHES, PairMatches, distances, fitting, repetition
from v3studio.studio.calibration.mistakes import Cameras, Mistake, mistakes, scaled
from v3studio.studio.calibration.outlines import Outlines
from v3studio.studio.calibration.report import CameraVerdict, RigVerdict
from v3studio.studio.counts import cameras_listed, listed

FITS = 0.85
"""Fraction of the matches that a correct rig fits at least: those tried have 0.91 to 0.99, folded ones 0.29 to 0.45."""
_DOUBTFUL, _TELLING = 0.5, 5 * LEAST_MATCHES
"""A camera is placed wrongly if a smaller share than the first number of its matches with the others fits, and it has
at least as many as the second: among 73, false matches of two repeating panels had outweighed the right ones."""
_MOST = 1 / 3  # of the cameras: if more disagree, it is the rig, or the masks, and not single cameras
_REPEATING = 0.2
"""Fraction of the matches that contradict each other, from which on they say nothing about cameras: 0.44 before walls
with a repeating pattern, up to 0.04 elsewhere."""
_TOUCHING, _APART = 0.6, 0.45
"""Fraction of the tangents of masks that a correct rig has at the same place at least (those tried: 0.7 to 1.0), and
that a wrong one has at most (all focal lengths and principal points 5% off: 0.3 to 0.44)."""
_FEW_TANGENTS, _ENOUGH_TANGENTS = 8, 24  # that can show a mistake which explains them; that can judge alone
_SCALES, _NEAR = np.geomspace(0.5, 2.0, 29), np.geomspace(0.95, 1.05, 11)
"""Factors of focal lengths that are tried, and the finer steps around the best of them."""

_SCALE_OFF = 0.04  # logarithm of a factor of all focal lengths from which on it is tested whether they are wrong


def judge(
    cameras: Cameras,
    pairs: Sequence[PairMatches],
    mask_errors: Mapping[str, float] | None,
    contradicting: Collection[str] = (),
    outlines: Outlines | None = None,
) -> RigVerdict:
    """Judge a rig of pinhole cameras by matches of their images (`match_images`), and by the outlines of their masks.

    `mask_errors`: disagreement of each mask with the others' volume; empty if the masks have no common volume, None if
    there are too few cameras or no masks. `contradicting`: cameras whose masks contradict the others.
    """
    evidence = _Evidence(cameras, pairs, outlines)
    figures = {
        name: CameraVerdict(
            matches=evidence.total(name),
            fits=None if (share := evidence.share(cameras, [name])) is None else round(share, 3),
            mask_error=None if mask_errors is None or name not in mask_errors else round(mask_errors[name], 3),
        )
        for name in cameras
    }
    verdict = _images(evidence)
    masks_wrong = mask_errors is not None and (not mask_errors or len(contradicting) > _MOST * len(cameras))
    if masks_wrong and verdict.blamed != "cameras":
        verdict = _masks(evidence, bool(mask_errors), contradicting)
    elif masks_wrong:  # misplaced cameras contradict the masks of all others
        verdict = verdict.model_copy(update={"grade": "wrong"})
    elif contradicting and verdict.grade != "wrong":
        others = [name for name in contradicting if name not in verdict.doubtful]
        words = [f"The masks of {cameras_listed(others)} contradict the others."] if others else []
        verdict = RigVerdict(
            grade="usable",
            reason=" ".join([verdict.reason, *words]),
            fix=verdict.fix or "Look at these masks, check that these cameras are in time, or leave them out.",
            doubtful=(*verdict.doubtful, *others),
            blamed=verdict.blamed or "masks",
        )
    overall, support = evidence.share(cameras), evidence.support(cameras)
    touching = None if support.tangents < _FEW_TANGENTS else round(support.touching, 3)
    fits = None if overall is None else round(overall, 3)
    return verdict.model_copy(update={"cameras": figures, "fits": fits, "touching": touching})


@dataclass(frozen=True)
class _Support:
    """Evidence of how well a rig fits: fraction of the matches, None if they are too few; number of the tangents of
    masks, and fraction of them that two cameras have at the same place."""

    matches: float | None
    tangents: int
    touching: float

    @property
    def masks_fit(self) -> bool:
        return self.tangents >= _FEW_TANGENTS and self.touching >= _TOUCHING

    @property
    def score(self) -> float:
        """A number to compare rigs by, up to 2."""
        return (self.matches or 0.0) + self.touching * (self.tangents >= _FEW_TANGENTS)

    @property
    def words(self) -> str:
        parts = [] if self.matches is None else [f"{self.matches:.0%} of the matches"]
        parts += [f"{self.touching:.0%} of the masks' tangents"] if self.tangents >= _FEW_TANGENTS else []
        return " and ".join(parts)


class _Evidence:
    """Matches of the cameras' images, and which cameras they can judge; and outlines of their masks."""

    def __init__(self, cameras: Cameras, pairs: Sequence[PairMatches], outlines: Outlines | None) -> None:
        self.cameras, self._pairs = cameras, [pair for pair in pairs if {pair.first, pair.second} <= cameras.keys()]
        repeating = repetition(self._pairs) >= _REPEATING
        if repeating:
            self._pairs = []
        self.lack = "repeat a pattern" if repeating else "have too few features in common"
        judged = [name for name in cameras if self.total(name) >= LEAST_MATCHES]
        self.known = len(cameras) > 1 and len(judged) > len(cameras) * (1 - _MOST)
        self.telling = self.known and float(np.median([self.total(name) for name in cameras])) >= _TELLING
        self._outlines = outlines.moved() if outlines is not None else None

    def total(self, name: str) -> int:
        return sum(len(pair.first_pixels) for pair in self._pairs if name in (pair.first, pair.second))

    def support(self, cameras: Cameras) -> _Support:
        """The evidence for a rig."""
        touched = self._outlines.fitting(cameras).values() if self._outlines is not None else ()
        tangents = sum(count for _, count in touched)
        touching = sum(same for same, _ in touched) / max(tangents, 1)
        return _Support(self.share(cameras) if self.known else None, tangents, touching)

    def explains(self, given: _Support, there: _Support) -> bool:
        """Whether a mistake explains what does not fit: undone, what is known of matches and masks fits much better."""
        gain = there.touching * there.tangents >= 1.5 * given.touching * given.tangents
        if there.matches is None or given.matches is None:
            return there.masks_fit and gain
        if self.telling:
            return there.matches >= FITS and there.matches > given.matches and (there.masks_fit or not self._outlines)
        return there.masks_fit and gain and there.matches > given.matches

    def share(self, cameras: Cameras, of: Collection[str] = (), without: Collection[str] = ()) -> float | None:
        """Fraction of the matches that fit, of pairs with one of the cameras `of` or all; None without matches."""
        return _share(fitting(cameras, [pair for pair in self._pairs if _counts(pair.first, pair.second, of, without)]))

    def median(self, cameras: Cameras) -> float:
        """Median distance of the matches from the epipolar lines, as a fraction of the images' longer side."""
        return float(np.median(np.concatenate(list(distances(cameras, self._pairs).values()))))

    def exchange(self) -> list[tuple[str, str]]:
        """Exchange the calibrations of pairs of cameras that do not fit, but then do; the pairs. Few matches tell: of
        471 exchanges in two rigs, each was found; no other pair fits more than 14% of its matches when exchanged."""

        def fits(cameras: Cameras, name: str) -> bool:
            return (self.share(cameras, [name]) or 0.0) >= _DOUBTFUL

        pairs = []
        suspects = [name for name in self.cameras if self.total(name) >= LEAST_MATCHES and not fits(self.cameras, name)]
        for pair in combinations(suspects, 2):
            calibrations = [replace(self.cameras[of], name=to) for of, to in (pair, pair[::-1])]
            exchanged = {**self.cameras, **{camera.name: camera for camera in calibrations}}
            if all(fits(exchanged, name) for name in pair):
                pairs.append(pair)
                self.cameras = exchanged
        return pairs

    def doubtful(self) -> list[str]:
        """Cameras whose matches with the others do not fit, found one at a time, the worst first."""
        counts = fitting(self.cameras, self._pairs)
        doubted: list[str] = []
        while True:
            shares = {
                name: share
                for name in self.cameras
                if name not in doubted
                and self.total(name) >= _TELLING
                and (share := _share({pair: n for pair, n in counts.items() if _counts(*pair, [name], doubted)}))
                is not None
            }
            worst = min(shares, key=lambda name: shares[name], default=None)
            if worst is None or shares[worst] >= _DOUBTFUL:
                return doubted
            doubted.append(worst)


def _counts(first: str, second: str, of: Collection[str], without: Collection[str]) -> bool:
    """Return whether a pair of cameras counts, see `_Evidence.share`."""
    pair = {first, second}
    return (not of or not pair.isdisjoint(of)) and pair.difference(of).isdisjoint(without)


def _share(counts: Mapping[tuple[str, str], tuple[int, int]]) -> float | None:
    total = sum(count for _, count in counts.values())
    return sum(good for good, _ in counts.values()) / total if total else None


def _images(evidence: _Evidence) -> RigVerdict:
    """The verdict of the matches, and of the outlines of masks."""
    given = evidence.support(evidence.cameras)
    if not evidence.known:
        if given.masks_fit and given.tangents >= _ENOUGH_TANGENTS:
            return RigVerdict(grade="good", reason=f"{given.words} fit the cameras.")
        cause = None if given.masks_fit else _cause(evidence, given)
        if cause is not None:
            return _wrong(given, cause)
        reason = f"The images {evidence.lack}, so they cannot check the cameras."
        apart = given.tangents >= _ENOUGH_TANGENTS and given.touching < _APART
        if apart:
            reason += f" Only {given.words} fit: the cameras or the masks are wrong."
        return RigVerdict(
            grade="usable",
            reason=reason,
            fix="Look at the footage over the mesh, or calibrate from footage with a textured background.",
            blamed="cameras or masks" if apart else "",
        )
    as_given, exchanged = evidence.cameras, evidence.exchange()
    alone = evidence.doubtful()
    doubtful = [*(name for pair in exchanged for name in pair), *alone]
    share = evidence.share(evidence.cameras, without=alone)
    if len(doubtful) > _MOST * len(evidence.cameras) or share is None or share < FITS:
        evidence.cameras = as_given  # by chance, some cameras of another rig fit better when exchanged
        cause = None if given.masks_fit else _cause(evidence, given)
        if cause is None and (given.masks_fit or not evidence.telling):
            return RigVerdict(
                grade="usable",
                reason=f"Not enough to judge the cameras: {given.words} fit them, but the matches are few, or of "
                "images that are too different.",
                fix="Look at the footage over the mesh.",
            )
        return _wrong(given, cause).model_copy(update={"doubtful": tuple(evidence.doubtful())})
    if doubtful:
        why, fix = _cause_of_some(evidence, alone, exchanged)
        return RigVerdict(
            grade="usable",
            reason=f"{cameras_listed(doubtful, 'Camera')} {'disagrees' if len(doubtful) == 1 else 'disagree'} "
            f"with the others: {evidence.share(as_given, doubtful, doubtful) or 0.0:.0%} of the matches fit."
            f"{why}",
            fix=fix,
            doubtful=tuple(doubtful),
            blamed="cameras",
        )
    scale = _wrong_scale(evidence)
    if scale is not None:
        return RigVerdict(
            grade="wrong",
            reason=f"This rig is wrong: with focal lengths {scale:.2f} times as long, the matches between the images "
            "are less than half as far from where the cameras put them.",
            fix="Check the focal lengths and the images' size.",
            blamed="cameras",
        )
    return RigVerdict(grade="good", reason=f"{share:.0%} of the matches between the images fit the cameras.")


def _wrong(given: _Support, cause: Mistake | None) -> RigVerdict:
    """A rig that does not fit, and the mistake that explains it, if one does. If most matches fit, the masks may be
    wrong instead."""
    if cause is None and (given.matches or 0.0) >= _DOUBTFUL and given.tangents >= _FEW_TANGENTS:
        return RigVerdict(
            grade="wrong",
            reason=f"The cameras or the masks are wrong: only {given.words} fit.",
            fix="Look at the masks on the Capture page, then check the calibration.",
            blamed="cameras or masks",
        )
    return RigVerdict(
        grade="wrong",
        reason=f"This rig is wrong: only {given.words or 'nothing'} fit its cameras"
        f"; a correct rig fits {FITS:.0%} of the matches or more." + ("" if cause is None else f" {cause.words}"),
        fix="Calibrate from more frames, with a board or marked points, or check the camera file."
        if cause is None
        else cause.fix,
        blamed="cameras",
        cause="" if cause is None else cause.kind,
    )


def _masks(evidence: _Evidence, some: bool, contradicting: Collection[str]) -> RigVerdict:
    """The masks contradict each other, and the images do not say that the cameras are wrong."""
    what = "the masks have no common volume"
    if some:
        what = f"the masks of {cameras_listed(contradicting)} contradict the others"
    if evidence.known:
        reason = f"The masks are wrong: {what}, while the matches between the images fit the cameras."
        fix = "Check capture.masks: a clean plate, mask files or another source."
    else:
        reason = f"The cameras or the masks are wrong: {what}. The images {evidence.lack}, so they cannot say which."
        fix = "Look at the masks on the Capture page, then check the calibration."
    return RigVerdict(
        grade="wrong",
        reason=reason,
        fix=fix,
        doubtful=tuple(contradicting),
        blamed="masks" if evidence.known else "cameras or masks",
    )


def _cause(evidence: _Evidence, given: _Support) -> Mistake | None:
    """The mistake in the whole rig that explains the evidence best, with figures in its words; None if none does."""
    cameras = evidence.cameras
    tried = list(mistakes(list(cameras)))
    for whole, what in ((False, "focal lengths"), (True, "focal lengths and principal points")):
        factor, _ = _best_factor(cameras, lambda changed: evidence.support(changed).score, whole=whole)
        words = f"With {what} {factor:.2f} times as long"
        kind, fix = "pixels" if whole else "focal", "Check the focal lengths and the images' size."
        tried.append(Mistake(kind, words, fix, partial(scaled, factor=factor, whole=whole)))
    best, highest = None, 0.0
    for mistake in tried:
        there = evidence.support(mistake.undo(cameras))
        # of two that nearly tie, the one that is tried first is the more common
        if there.score > highest + 0.02 and evidence.explains(given, there):
            best, highest = replace(mistake, words=f"{mistake.words}, {there.words} fit."), there.score
    return best


def _cause_of_some(evidence: _Evidence, alone: Sequence[str], exchanged: Sequence[tuple[str, str]]) -> tuple[str, str]:
    """Return why single cameras may disagree: two are exchanged, or a focal length is wrong."""
    words, fixes = "", []
    for pair in exchanged:
        share = evidence.share(evidence.cameras, pair) or 0.0
        words += f" {pair[0]} and {pair[1]} are exchanged: the other way, they fit ({share:.0%})."
    if exchanged:
        fixes.append("Exchange their names in the camera file or the footage.")
    for name in alone:
        best, share = _best_scale(evidence, name, alone)
        if share >= FITS:
            words += f" With a focal length {best:.2f} times as long, {name} fits ({share:.0%})."
    if alone:
        fixes.append(f"Leave {listed(alone)} out with capture.cameras, or calibrate again.")
    return words, " ".join(fixes)


def _best_scale(evidence: _Evidence, name: str, without: Collection[str]) -> tuple[float, float]:
    """The factor of a camera's focal length with which most of its matches fit, and their fraction."""
    return _best_factor(evidence.cameras, lambda changed: evidence.share(changed, [name], without) or 0.0, names=[name])


def _best_factor(
    cameras: Cameras, score: Callable[[Cameras], float], *, whole: bool = False, names: Collection[str] | None = None
) -> tuple[float, float]:
    """The factor with which cameras that are `scaled` have the highest score, and that score."""
    best = 1.0
    for around in (_SCALES, _NEAR):
        scores = {scale: score(scaled(cameras, scale, whole=whole, names=names)) for scale in (best * around).tolist()}
        best = max(scores, key=lambda scale: scores[scale])
    return best, scores[best]


def _wrong_scale(evidence: _Evidence) -> float | None:
    """The factor by which all focal lengths are wrong, though most matches fit: cameras that nearly face one point
    tolerate 10%. None if they are not."""
    best, score = _best_factor(evidence.cameras, lambda changed: -evidence.median(changed))
    return best if abs(np.log(best)) > _SCALE_OFF and -score < evidence.median(evidence.cameras) / 2 else None
