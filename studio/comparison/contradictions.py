"""Finds where masks contradict the footage: parts of the performer that they lost, and parts of the set that they kept.

The evidence in an image is its difference from the empty set. A part that differs as the performer does and touches the
mask, but is outside of it, is *missing*, if the differences in the other cameras support it in space: a lamp that
flickers before one camera has no such support. A part of the mask that equals the set in all frames that are looked at
is *extra*, if other cameras do not support it either: clothes may have the color of what is behind them in one camera.

A part that a mask lacks is also missing if the masks of the frames before and after it have it, or if one of them does
and the image has not changed there.

Without an image of the set, masks are compared with each other: a part of the other cameras' hull that a mask lacks is
missing as far as it exceeds what hulls usually have around the performer, in this camera and in all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Literal

import numpy as np

from v3studio.studio.capture.settings import DifferenceSettings
from v3studio.studio.comparison.view_pair import Behind
from v3studio.studio.masks.agreement.vote import heard
from v3studio.studio.masks.clean_plate import difference_evidence, match_exposure
from v3studio.studio.masks.filters import largest_channel, reduced, touching

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera, FootageView
    from v3studio.studio.gaussians import Gaussians

Kind = Literal["missing", "extra"]

LEAST_SHARE = 0.04
"""Share of the performer's area from which a contradiction counts."""
FEWEST_CAMERAS = 6
"""Fewer cannot support each other."""
_SIDE = 320
"""Longest side of the images that are compared."""
_DIFFERENT, _EQUAL = 4.0, -1.0
"""Log-odds of the difference from which a part differs as the performer does, and up to which it equals the set."""
_UNCHANGED = 8.0
"""Levels of 255 up to which a pixel has not changed between two frames."""
_SUPPORTED = 0.5
"""Votes of the other cameras from which a part is the performer's."""
_MARGIN = 1 / 320
"""Half of the least width of a part, as a fraction of the image's longer side: outlines are ragged."""
_SURE = 2.0
"""Log-odds of masks in the votes without an image of the set."""
_IN_HULL, _NOT_IN_HULL = 1.5, -1.5
"""Votes from which a part is in nearly all of the other masks, and up to which it is in too few of them."""
_USUAL = 2.0
"""Weight of what is usual in a capture, in the least share without an image of the set."""
_FEWEST_SHARES = 3
"""Fewer shares do not show what is usual."""


@dataclass(frozen=True, eq=False)
class CheckedView:
    """A view at reduced size (h, w): its camera; its mask, bool; and log-odds of the difference from the set, float32,
    0 where the set is not known. Without any image of the set, these are from the mask."""

    camera: Camera
    image: np.ndarray  # (h, w, 3) float32 RGB in 0 to 255, slightly blurred
    mask: np.ndarray
    odds: np.ndarray
    knows_set: bool

    @classmethod
    def of(cls, view: FootageView, plate: np.ndarray | None, settings: DifferenceSettings) -> CheckedView:
        """A view of the footage; `plate`: as `FootageView.plate`."""
        import cv2

        mask, image = reduced(view.mask, _SIDE) > 127, reduced(view.image, _SIDE).astype(np.float32)
        if plate is None:
            odds = np.where(mask, np.float32(_SURE), np.float32(-_SURE))
        else:
            odds = difference_odds(view.image, plate, settings)
        camera = view.camera.resized(mask.shape[1], mask.shape[0])
        return cls(camera, cv2.GaussianBlur(image, (0, 0), 1.0), mask, odds, plate is not None)


@dataclass(frozen=True)
class MaskContradiction:
    """A part of a camera's mask in a frame that contradicts the footage. `share`: of the performer's area, 0 to 1."""

    frame: int
    camera: str
    kind: Kind
    share: float


def difference_odds(image: np.ndarray, plate: np.ndarray, settings: DifferenceSettings) -> np.ndarray:
    """Log-odds, (h, w) float32 at reduced size, that an image (H, W, 3) uint8 does not show the set (`plate`, as in
    `FootageView`); 0 where that is not known."""
    ours, empty = (reduced(pixels[..., :3], _SIDE).astype(np.float32) for pixels in (image, plate))
    known = None if plate.shape[2] == 3 else reduced((plate[..., 3] > 0).astype(np.float32), _SIDE) > 0.99
    empty *= match_exposure(ours, empty, known)
    odds = difference_evidence(ours, empty, settings)
    return odds if known is None else np.where(known, odds, np.float32(0))


def doubted(image: np.ndarray, mask: np.ndarray, plate: np.ndarray, settings: DifferenceSettings) -> np.ndarray:
    """Return where an image (H, W, 3) uint8 contradicts its mask (H, W) uint8 by its difference from the set (`plate`,
    as in `FootageView`), (H, W) bool: what differs as the performer does and touches the mask, but is outside of it;
    and what equals the set inside. Of clothes in the color of the set, too, so this is doubt, not proof."""
    import cv2

    odds, ours = difference_odds(image, plate, settings), reduced(mask, _SIDE) > 127
    area = _reached(_opened((odds > _DIFFERENT) & ~ours), ours) | _opened((odds < _EQUAL) & ours)
    return cv2.resize(area.astype(np.uint8), mask.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0


def behind(
    image: np.ndarray,
    mask: np.ndarray,
    plate: np.ndarray,
    settings: DifferenceSettings,
    scene: Gaussians | None = None,
) -> Behind:
    """Return what is behind the performer in an image (H, W, 3) uint8, of which `plate` is the set, as in
    `FootageView`, but without holes; and where the performer is, by the mask (H, W) uint8 or by the difference from the
    set. `scene`: see `Behind`."""
    return Behind(lit(plate, image), performer_area(mask, difference_odds(image, plate, settings)), scene)


def lit(plate: np.ndarray, image: np.ndarray) -> np.ndarray:
    """A plate as bright as an image (H, W, 3) uint8: (H, W, 3) float32 RGB in 0 to 1."""
    known = None if plate.shape[2] == 3 else plate[..., 3] > 0
    empty = plate[..., :3].astype(np.float32)
    empty *= match_exposure(image.astype(np.float32), empty, known)
    return np.clip(empty / 255, 0, 1)


def performer_area(mask: np.ndarray, odds: np.ndarray) -> np.ndarray:
    """Return where the performer is by the mask (H, W) uint8, or by the `difference_odds` (h, w): (H, W) bool."""
    import cv2

    differs = _opened(odds > _DIFFERENT).astype(np.uint8)
    return (mask > 127) | (cv2.resize(differs, mask.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0)


def contradicting_masks(frames: Iterable[tuple[int, Mapping[str, CheckedView]]]) -> tuple[MaskContradiction, ...]:
    """Return where masks contradict the footage, in frames that belong together, each with its number and its views by
    camera: in the order of frames, with shares of at least `LEAST_SHARE`."""
    parts: list[_Part] = []
    equal: dict[str, np.ndarray] = {}  # by camera, where all frames so far equal the set
    none: tuple[int, Mapping[str, CheckedView]] = (0, {})
    before, now = none, none
    for after in chain(frames, (none,)):
        for camera, view in now[1].items():
            same = view.odds < _EQUAL
            equal[camera] = equal[camera] & same if camera in equal else same
        if now is not none:
            parts += _parts(*now, [views for _, views in (before, after) if views])
        before, now = now, after
    parts = [
        replace(part, area=_opened(part.area & equal[part.camera])) if part.sure and part.kind == "extra" else part
        for part in parts
    ]
    by_hull: dict[tuple[Kind, str], list[float]] = {}
    for part in parts:
        if not part.sure:
            for camera in ("", part.camera):  # of all cameras, and of one
                by_hull.setdefault((part.kind, camera), []).append(part.share)

    def least(part: _Part) -> float:
        if part.sure:
            return LEAST_SHARE
        shares = [by_hull[part.kind, camera] for camera in ("", part.camera)]
        usual = [float(np.median(each)) for each in shares if len(each) >= _FEWEST_SHARES]
        return LEAST_SHARE + _USUAL * max(usual, default=0.0)

    shares: dict[tuple[int, str, Kind], float] = {}
    for part in parts:
        if part.share >= least(part):
            key = (part.frame, part.camera, part.kind)
            shares[key] = max(shares.get(key, 0.0), round(part.share, 4))
    return tuple(MaskContradiction(*key, share) for key, share in shares.items())


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a view that may contradict its mask."""

    frame: int
    camera: str
    kind: Kind
    area: np.ndarray  # (h, w) bool
    performer: int  # pixels of the performer
    sure: bool  # not only by the hull of the other cameras

    @property
    def share(self) -> float:
        return float(self.area.sum()) / max(self.performer, 1)


def _parts(frame: int, views: Mapping[str, CheckedView], neighbors: Sequence[Mapping[str, CheckedView]]) -> list[_Part]:
    """Return what may contradict the masks of a frame; `neighbors`: the views of the frames before and after it."""
    by_set, enough = all(view.knows_set for view in views.values()), len(views) >= FEWEST_CAMERAS
    flickers = {camera: _flickers(view, [each[camera] for each in neighbors]) for camera, view in views.items()}
    lost, kept = ({camera: np.zeros_like(view.mask) for camera, view in views.items()} for _ in range(2))
    if by_set:
        lost = {camera: _opened((view.odds > _DIFFERENT) & ~view.mask) for camera, view in views.items()}
        kept = {camera: _opened((view.odds < _EQUAL) & view.mask) for camera, view in views.items()}
    least = {camera: LEAST_SHARE * view.mask.sum() for camera, view in views.items()}
    if enough and (not by_set or any((lost[name] | kept[name]).sum() > least[name] for name in views)):
        odds = {camera: view.odds for camera, view in views.items()}
        votes = heard(odds, {camera: view.camera for camera, view in views.items()}, frozenset(views))
        for camera, view in views.items():
            vote = votes[camera]
            if by_set:
                lost[camera] &= vote > _SUPPORTED
                kept[camera] &= vote < 0
            else:
                lost[camera] = _opened((vote > _IN_HULL) & ~view.mask)
                kept[camera] = _opened((vote < _NOT_IN_HULL) & view.mask)
    parts = []
    for camera, view in views.items():
        areas = {True: flickers[camera] | (lost[camera] & by_set)}
        if not by_set:
            areas[False] = lost[camera]
        for sure, area in areas.items():
            lacks = _reached(area, view.mask)
            parts.append(_Part(frame, camera, "missing", lacks, int((view.mask | lacks).sum()), sure))
        parts.append(_Part(frame, camera, "extra", kept[camera], int(view.mask.sum()), by_set))
    return parts


def _flickers(view: CheckedView, neighbors: Sequence[CheckedView]) -> np.ndarray:
    """Return where a mask lacks what the masks before and after it have, or what one of them has where the image has
    not changed; but not where the image equals the set."""
    lacks = np.zeros_like(view.mask)
    for other in neighbors:
        lacks |= other.mask & (largest_channel(abs(other.image - view.image)) <= _UNCHANGED)
    if len(neighbors) == 2:
        lacks |= neighbors[0].mask & neighbors[1].mask
    return _opened(lacks & ~view.mask & ((view.odds > _EQUAL) | (not view.knows_set)))


def _reached(area: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The parts of an area (h, w) bool that a mask (h, w) bool reaches."""
    import cv2

    return touching(area, cv2.dilate(mask.astype(np.uint8), _disc(area.shape)) > 0)


def _opened(area: np.ndarray) -> np.ndarray:
    """The parts of an area (h, w) bool that are wide enough."""
    import cv2

    return cv2.morphologyEx(area.astype(np.uint8), cv2.MORPH_OPEN, _disc(area.shape)) > 0


def _disc(shape: tuple[int, ...]) -> np.ndarray:
    import cv2

    radius = max(1, round(_MARGIN * max(shape)))
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
