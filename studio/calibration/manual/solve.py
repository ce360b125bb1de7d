"""Cameras from points that somebody marked by hand in their pictures.

For rigs whose cameras stand too far apart to find common features by themselves, and have no board: a corner of the
mat, a bolt, a marker on the performer at one moment. With a few of them measured the world is metric.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from studio.calibration.alignment import align_points, scale_to_distance, upright
from studio.calibration.manual.bootstrap import LEAST_PLACED, LEAST_SHARED, Observations, TieRig, starts
from studio.calibration.manual.bundle_adjustment import Accuracy, adjust
from studio.calibration.manual.covariance import contradiction, spread_of_positions, uncertainty
from studio.calibration.manual.file import TiePoint
from studio.calibration.result import CalibrationResult, reprojection_report
from studio.calibration.settings import CalibrateSettings
from studio.calibration.target.intrinsics import check_lens_size
from studio.cameras import Camera, Rig
from studio.errors import StudioError

_GUESSES = (1.2, 0.9, 0.7, 1.6, 2.2)
"""Focal lengths in longer image sides to begin with where nothing is known of a lens."""
_ROUGH = 60
"""Steps of an attempt's adjustment."""
_GOOD = 2.0
"""Mean error, in the marks' standard deviations, with which no further attempt is made."""
_OUTLIER = 6.0
"""Times the usual error, beyond which a mark is taken for a mistake."""
_LEAST_OUTLIER = 8.0
"""Pixels at 2000 for the longer image side: nearer marks are no mistakes, only careless."""

_VAGUE = 0.2
"""Share of the distance to the points; a camera whose place the marks leave open by more is nowhere."""


def calibrate_from_tie_points(
    points: Sequence[TiePoint],
    sizes: Mapping[str, tuple[int, int]],
    *,
    known: Mapping[str, Camera] | None = None,
    focal_lengths: Mapping[str, float] | None = None,
    distance: tuple[str, str, float] | None = None,
    settings: CalibrateSettings | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> CalibrationResult:
    """Find the cameras from marks.

    Args:
        points: what was marked; cameras that are not in `sizes` are not looked at.
        sizes: width and height of each camera's pictures; names all cameras.
        known: cameras whose lenses are known and stay; their poses are not used.
        focal_lengths: pixels, where a photograph's data say one; a start.
        distance: two cameras and their distance, where no place was measured.
        settings: how to solve.
        seed: of all random choices.
        progress: of the attempts.

    Returns:
        cameras and the points. With three measured places or more the world is theirs; else it is as in
        `gauge.upright`. The report has, beside `reprojection_report`'s figures, `tie_points`: name to `error` (mean,
        pixels), `cameras` (how many see it) and `off` (meters from where it was measured, where it was);
        `left_out`: marks taken for mistakes, {point, camera, error} (None: behind the camera); `uncertain`: camera to
        what the marks leave open of its place (`covariance.uncertainty`); `world_accuracy`; `known_lenses`; `metric`;
        `unregistered` (empty).

    Raises:
        StudioError: a camera sees too few of the points that others see (named), nothing fits, or points on a line say
            too little.
    """
    settings, known = settings or CalibrateSettings(), dict(known or {})
    accuracy = _accuracy(settings)
    observations = _observations(points, sizes)
    free = [name for name in sizes if name not in known]
    groups = _groups(free, sizes, settings.shared_intrinsics)
    guesses = _GUESSES if any(name not in (focal_lengths or {}) for name in free) else _GUESSES[:1]

    def attempts() -> Iterator[TieRig]:
        for number, guess in enumerate(guesses):
            progress(number, len(guesses) + 1)
            lenses = _lenses(sizes, known, focal_lengths or {}, guess)
            for start in starts(lenses, observations, seed):
                if len(start.cameras) >= 2:
                    yield adjust(start, observations, groups, accuracy, radial=False, steps=_ROUGH)

    best = _best(attempts(), observations, _GOOD * accuracy.mark)
    if best is None or len(best.cameras) < len(sizes):
        raise StudioError(_lonely(observations, sizes, best))
    best, left_out = _settled(best, observations, groups, settings)
    unsure = uncertainty(best, observations, groups, accuracy, radial=settings.has_distortion)
    vague = [name for name in sizes if unsure[name] > _VAGUE]
    if vague:
        raise StudioError(
            f"The marks do not say where {', '.join(vague)} {'stands' if len(vague) == 1 else 'stand'}: the points lie "
            "on a line, too close together, or are too few; mark others that are spread over the picture and in depth."
        )
    progress(len(guesses) + 1, len(guesses) + 1)
    result = _result(best, observations, left_out, distance, sizes)
    result.report |= {
        "known_lenses": [name for name in sizes if name in known],
        "uncertain": {name: round(unsure[name], 4) for name in sizes},
        "world_accuracy": accuracy.world,
    }
    return result


def _best(attempts: Iterable[TieRig], observations: Observations, good: float) -> TieRig | None:
    """The first attempt with all cameras and a misfit below `good`, else the one with most cameras and the least."""
    best, rank = None, (0, -np.inf)
    for found in attempts:
        own = (len(found.cameras), -_misfit(found, observations))
        if own > rank:
            best, rank = found, own
        if rank[0] == len(observations.pixels) and -rank[1] < good:
            break
    return best


def _observations(points: Sequence[TiePoint], sizes: Mapping[str, tuple[int, int]]) -> Observations:
    nothing = (np.nan, np.nan)
    used = [point for point in points if any(name in sizes for name in point.pixels)]
    for point in used:
        for name, (x, y) in point.pixels.items():
            if name in sizes and not (0 <= x <= sizes[name][0] and 0 <= y <= sizes[name][1]):
                raise StudioError(
                    f"Point '{point.name}' is marked at ({x:g}, {y:g}) in {name}, outside its image of "
                    f"{sizes[name][0]}x{sizes[name][1]}; mark it again in pictures of that size."
                )
    if not used:
        raise StudioError(f"No tie point is marked in any of the cameras {', '.join(sizes)}; mark some.")
    return Observations(
        [point.name for point in used],
        np.array([point.world if point.world is not None else (np.nan,) * 3 for point in used], np.float64),
        {name: np.array([point.pixels.get(name, nothing) for point in used], np.float64) for name in sizes},
    )


def _groups(free: Sequence[str], sizes: Mapping[str, tuple[int, int]], shared: bool | None) -> list[list[str]]:
    if shared is False:
        return [[name] for name in free]
    return [[name for name in free if sizes[name] == size] for size in dict.fromkeys(sizes[name] for name in free)]


def _lenses(
    sizes: Mapping[str, tuple[int, int]], known: Mapping[str, Camera], focal: Mapping[str, float], guess: float
) -> dict[str, Camera]:
    found = {}
    for name, (width, height) in sizes.items():
        if name in known:
            check_lens_size(known[name], (width, height))
            found[name] = known[name]
        else:
            own = focal[name] if name in focal else guess * max(width, height)
            K = np.array([[own, 0, width / 2], [0, own, height / 2], [0, 0, 1.0]])
            found[name] = Camera(name, width, height, K, np.eye(4))
    return found


def _misfit(rig: TieRig, observations: Observations) -> float:
    """Mean error in pixels, each counted up to a hundredth of the image."""
    errors = rig.errors(observations)
    limits = {name: 0.01 * max(camera.width, camera.height) for name, camera in rig.cameras.items()}
    every = np.concatenate([np.minimum(error[~np.isnan(error)], limits[name]) for name, error in errors.items()])
    return float(every.mean()) if len(every) else np.inf


def _accuracy(settings: CalibrateSettings) -> Accuracy:
    return Accuracy(mark=settings.tie_accuracy, world=settings.tie_world_accuracy)


def _settled(
    rig: TieRig, observations: Observations, groups: list[list[str]], settings: CalibrateSettings
) -> tuple[TieRig, list[dict[str, Any]]]:
    """Adjusted, with marks left out that must be mistakes, the worst one first."""
    left_out: list[dict[str, Any]] = []
    while True:
        rig = adjust(rig, observations, groups, _accuracy(settings), radial=settings.has_distortion)
        errors = rig.errors(observations)
        wrong = contradiction(rig, observations)
        if wrong:
            raise StudioError(wrong)
        usual = float(np.nanmedian(np.concatenate(list(errors.values()))))
        worst, where = 0.0, None
        for name, error in errors.items():
            limit = max(
                _OUTLIER * usual, _LEAST_OUTLIER / 2000 * max(rig.cameras[name].width, rig.cameras[name].height)
            )
            shares = np.nan_to_num(error, nan=0.0, posinf=1e6) / limit
            if shares.max() > max(worst, 1.0):
                worst, where = float(shares.max()), (name, int(shares.argmax()))
        if where is None:
            return rig, left_out
        name, number = where
        left_out.append(
            {"point": observations.points[number], "camera": name, "error": _rounded(float(errors[name][number]))}
        )
        observations.pixels[name][number] = np.nan
        seen_by = sum(bool(observations.seen(other)[number]) for other in rig.cameras)
        if seen_by < 2 and not observations.measured[number]:
            for other in rig.cameras:
                observations.pixels[other][number] = np.nan
            rig.places[number] = np.nan
        if int(observations.seen(name).sum()) < LEAST_PLACED:
            raise StudioError(
                f"Camera '{name}': its marks do not fit those of the others ({', '.join(m['point'] for m in left_out)} "
                "lie farthest off); mark them again, or more of them."
            )


def _rounded(error: float) -> float | None:
    """None behind the camera."""
    return round(error, 2) if np.isfinite(error) else None


def _lonely(observations: Observations, sizes: Mapping[str, tuple[int, int]], best: TieRig | None) -> str:
    """Who could not be placed, and what is missing."""
    standing = [name for name in sizes if name in best.cameras] if best is not None else []
    lost = [name for name in sizes if name not in standing]
    marks = {name: int(observations.seen(name).sum()) for name in sizes}
    measured = {name: int((observations.seen(name) & observations.measured).sum()) for name in sizes}
    if best is None or not standing:
        return (
            f"The tie points place no two cameras to each other: two of them must share {LEAST_SHARED} points that do "
            f"not all lie on a line, or see {LEAST_PLACED} points with a measured place; marked are "
            f"{', '.join(f'{name} {marks[name]} ({measured[name]} measured)' for name in sizes)}."
        )
    name = lost[0]
    known = int((observations.seen(name) & best.placed).sum())
    return (
        f"Camera '{name}'"
        + (f" and {len(lost) - 1} more ({', '.join(lost[1:])})" if len(lost) > 1 else "")
        + f" found no place beside {', '.join(standing)}: it sees {known} of the points whose place these give, and "
        f"needs {LEAST_PLACED} that fit; mark more points in both."
    )


def _result(
    rig: TieRig,
    observations: Observations,
    left_out: list[dict[str, Any]],
    distance: tuple[str, str, float] | None,
    sizes: Mapping[str, tuple[int, int]],
) -> CalibrationResult:
    cameras = Rig(tuple(rig.cameras[name] for name in sizes))
    kept = np.flatnonzero(rig.placed)
    places, world = rig.places[kept], observations.world[kept]
    measured = ~np.isnan(world[:, 0])
    metric = spread_of_positions(world[measured]) == 2
    if metric:
        similarity = align_points(places[measured], world[measured])
    else:
        similarity = upright(cameras, places)
    cameras, places = similarity.rig(cameras), similarity.points(places)
    if distance is not None and not metric:
        scaling = scale_to_distance(cameras, *distance)
        cameras, places = scaling.rig(cameras), scaling.points(places)
    by_camera = {}
    for name in sizes:
        seen = observations.seen(name)[kept]
        by_camera[name] = np.column_stack([np.flatnonzero(seen), observations.pixels[name][kept][seen]])
    report = reprojection_report(cameras, places, by_camera)
    report["tie_points"] = _figures(cameras, places, by_camera, [observations.points[k] for k in kept], world)
    report |= {"left_out": left_out, "metric": bool(metric or distance is not None), "unregistered": {}}
    return CalibrationResult(cameras, places, np.full((len(places), 3), 255, np.uint8), report)


def _figures(
    rig: Rig, places: np.ndarray, observations: dict[str, np.ndarray], names: list[str], world: np.ndarray
) -> dict[str, Any]:
    errors: dict[int, list[float]] = {number: [] for number in range(len(names))}
    for camera in rig:
        rows = observations[camera.name]
        index = rows[:, 0].astype(int)
        off = np.linalg.norm(camera.project(places[index])[0] - rows[:, 1:], axis=1)
        for number, error in zip(index, off, strict=True):
            errors[int(number)].append(float(error))
    found: dict[str, Any] = {}
    for number, name in enumerate(names):
        found[name] = {
            "error": round(float(np.mean(errors[number])), 3) if errors[number] else None,
            "cameras": len(errors[number]),
        }
        if not np.isnan(world[number, 0]):
            found[name]["off"] = round(float(np.linalg.norm(places[number] - world[number])), 5)
    return found
