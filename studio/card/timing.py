"""When images were taken, compared with those of the other cameras, from how the outlines of the performer move."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from v3studio.studio.calibration.outlines import Outlines
from v3studio.studio.cameras import Camera

_FURTHEST = 12  # frames that are searched to each side, if the footage has as many
_FINE = 0.05
_OVERLAP = 3  # frames that must be compared
_CAP = 0.01  # distance of tangents beyond which they are of different things
_CLEAR = 0.6
"""The best lag of two cameras tells if their tangents are this much nearer there than at the median of all lags."""
_PARTNERS = 2  # other cameras with which a camera must agree on its lag
_ROUNDS = 2

Heights = Mapping[tuple[str, str], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Lag:
    """Frames by which a camera is late; negative: early. `partners`: cameras with which it was compared, clearly;
    `spread`: half of the lags from single ones are within it."""

    frames: float
    partners: int
    spread: float

    @property
    def known(self) -> bool:
        return self.partners >= _PARTNERS


def lags(
    outlines: Outlines, cameras: Mapping[str, Camera], runs: Iterable[slice], windows: Iterable[slice]
) -> dict[str, list[Lag]]:
    """By camera, its lag in all runs of consecutive frames together, and in each window. The median of all cameras is
    0."""
    heights, names = outlines.heights(cameras), list(outlines.hulls)
    parts = [window for window in windows if window.stop - window.start > _OVERLAP]
    together = _solve(names, heights, [run for run in runs if run.stop - run.start > _OVERLAP], {})
    middle = {name: lag.frames for name, lag in together.items() if lag.known}
    single = [_solve(names, heights, [window], middle) for window in parts]
    return {name: [together[name], *(each[name] for each in single)] for name in names}


def _solve(names: list[str], heights: Heights, windows: list[slice], start: Mapping[str, float]) -> dict[str, Lag]:
    """Move each camera in turn to where it fits the others best."""
    now = {name: start.get(name, 0.0) for name in names}
    found: dict[str, Lag] = {}
    for _ in range(1 if start else _ROUNDS):
        found = {name: _lag(name, heights, windows, now) for name in names}
        known = [lag.frames for lag in found.values() if lag.known]
        middle = float(np.median(known)) if known and not start else 0.0
        found = {name: Lag(lag.frames - middle, lag.partners, lag.spread) for name, lag in found.items()}
        if not start:
            now = {name: lag.frames if lag.known else 0.0 for name, lag in found.items()}
    return found


def _lag(name: str, heights: Heights, windows: list[slice], now: Mapping[str, float]) -> Lag:
    """Return how late a camera is, the others being as late as `now` says."""
    most = min(_FURTHEST, max((window.stop - window.start for window in windows), default=0) - _OVERLAP)
    if most < 1:
        return Lag(0.0, 0, 0.0)
    wide = np.arange(-most, most + 1.0)
    total = _costs(name, heights, windows, now, wide)
    comparable = np.isfinite(total).all(1)
    if not comparable.any():
        return Lag(0.0, 0, 0.0)
    best = float(wide[total[comparable].mean(0).argmin()])
    near = best + np.arange(-1, 1 + _FINE / 2, _FINE)
    fine = np.nan_to_num(_costs(name, heights, windows, now, near), nan=_CAP)
    clear = comparable & (fine.min(1) < _CLEAR * np.median(total, 1))
    if not clear.any():
        return Lag(0.0, 0, 0.0)
    own = near[fine[clear].argmin(1)]
    lag = float(near[fine[clear].mean(0).argmin()])
    return Lag(lag, int(clear.sum()), float(np.median(np.abs(own - lag))))


def _costs(name: str, heights: Heights, windows: list[slice], now: Mapping[str, float], lags: np.ndarray) -> np.ndarray:
    """(partners, lags) mean distance of a camera's tangents from those of each other one, at each lag; NaN for those
    with which it cannot be compared."""
    rows = []
    for pair, tangents in heights.items():
        if name not in pair:
            continue
        own, other = tangents if name == pair[0] else tangents[::-1]
        ahead = now[pair[1] if name == pair[0] else pair[0]]
        off = np.concatenate([_apart(own[window], other[window], ahead, lags) for window in windows], 1)
        known = np.isfinite(off)
        counts = known.sum((1, 2))
        least = min(2 * _OVERLAP, 2 * off.shape[1])
        sums = np.where(known, np.minimum(off, _CAP), 0).sum((1, 2))
        cost = np.where(counts >= least, sums / np.maximum(counts, 1), np.nan)
        enough = np.isfinite(cost).sum() > len(lags) // 3
        rows.append(np.where(np.isfinite(cost), cost, _CAP) if enough else np.full(len(lags), np.nan))
    return np.array(rows)


def _apart(own: np.ndarray, other: np.ndarray, ahead: float, lags: np.ndarray) -> np.ndarray:
    """(lags, frames, 2) distances of tangents (frames, 2), the first ones that many frames later."""
    count = np.arange(len(own), dtype=np.float64)
    return np.abs(_at(own, count + lags[:, None]) - _at(other, count[None] + ahead))


def _at(values: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Values (N, 2) at fractional frames; NaN outside."""
    before = np.clip(np.floor(frames + 1e-9).astype(int), 0, len(values) - 1)
    after, share = np.minimum(before + 1, len(values) - 1), (frames - before)[..., None]
    outside = (frames < -1e-9) | (frames > len(values) - 1 + 1e-9)
    exact = np.abs(share) < 1e-9
    between = np.where(exact, values[before], values[before] * (1 - share) + values[after] * share)
    return np.where(outside[..., None], np.nan, between)
