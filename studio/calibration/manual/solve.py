"""Calibration from tie points marked by hand in the images.

For rigs whose cameras are too far apart for automatic feature matching, if there is no calibration target. A tie point
can be the corner of a mat, a bolt, or a marker on the performer in one frame. If the positions of a few points are
known from measurements, the world is metric.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from v3studio.studio.calibration.alignment import align_points, scale_to_distance, upright
from v3studio.studio.calibration.initial_intrinsics import initial_camera
from v3studio.studio.calibration.manual.bootstrap import LEAST_KNOWN, LEAST_SHARED, Observations, TieRig, initial_rigs
from v3studio.studio.calibration.manual.bundle_adjustment import MARK, adjust
from v3studio.studio.calibration.manual.covariance import check_handedness, check_plausible, uncertainty
from v3studio.studio.calibration.manual.file import TiePoint
from v3studio.studio.calibration.report import RejectedMark, TiePointReport
from v3studio.studio.calibration.result import CalibrationResult, reprojection_report
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.footage import refuse_unknown_cameras

_GUESSES = (1.2, 0.9, 0.7, 1.6, 2.2)  # initial focal lengths of unknown lenses, as multiples of the longer image side
_ROUGH = 60  # maximum number of function evaluations per attempt
_GOOD = 2.0  # mean error, in standard deviations of the marks, that ends the search
_OUTLIER = 6.0  # multiple of the median error beyond which a mark is an outlier
_LEAST_OUTLIER = 8.0  # errors below this are never outliers; in pixels for images whose longer side is 2000 pixels
_VAGUE = 0.2  # maximum accepted position uncertainty of a camera, as a fraction of the distance to the points


def calibrate_from_tie_points(
    points: Sequence[TiePoint],
    sizes: Mapping[str, tuple[int, int]],
    *,
    known: Mapping[str, Camera] | None = None,
    focal_lengths: Mapping[str, float] | None = None,
    settings: CalibrateSettings | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> CalibrationResult:
    """Estimate the cameras from marked tie points.

    Args:
        points: the tie points; marks in cameras that are not in `sizes` are ignored.
        sizes: camera name to (width, height) of its images, for all cameras to calibrate.
        known: cameras with fixed intrinsics; their poses are not used.
        focal_lengths: initial focal lengths in pixels, for example from EXIF.
        progress: called per attempt.

    Returns:
        cameras and triangulated points. With three measured positions that are not collinear, world coordinates are
        those of the measurements; otherwise they are those of `alignment.upright`, with the scale of
        `settings.known_distance`. The report contains `tie_points`,
        `left_out`, `uncertain`, `known_intrinsics` and `metric`.

    Raises:
        StudioError: there are no marks (tie_points.none) or one is outside its image (tie_points.outside), a camera
            cannot be registered (tie_points.unregistered), no solution is consistent with the marks
            (tie_points.contradiction, tie_points.behind, tie_points.inconsistent), or camera positions are not
            determined (tie_points.degenerate).
    """
    settings, known, focal_lengths = settings or CalibrateSettings(), known or {}, focal_lengths or {}
    wide = {name: camera for name, camera in known.items() if camera.fisheye and name in sizes}
    if wide:  # solved by their pinhole views
        views = {name: camera.undistorted() for name, camera in wide.items()}
        result = calibrate_from_tie_points(
            [replace(point, pixels=_in_views(point.pixels, wide, views)) for point in points],
            {**sizes, **{name: (view.width, view.height) for name, view in views.items()}},
            known={**known, **views},
            focal_lengths=focal_lengths,
            settings=settings,
            seed=seed,
            progress=progress,
        )
        cameras = (replace(wide.get(own.name, own), world_to_camera=own.world_to_camera) for own in result.rig)
        return replace(result, rig=Rig(tuple(cameras)))
    refuse_unknown_cameras((settings.known_distance or ())[:2], list(sizes), "calibrate.known_distance")
    observations = _observations(points, sizes)
    free = [name for name in sizes if name not in known]
    groups = _groups(free, sizes, settings.shared_intrinsics)
    guesses = _GUESSES if any(name not in focal_lengths for name in free) else _GUESSES[:1]

    def attempts() -> Iterator[TieRig]:
        for number, guess in enumerate(guesses):
            progress(number, len(guesses) + 1)
            intrinsics = {n: initial_camera(n, size, known, focal_lengths, guess) for n, size in sizes.items()}
            for start in initial_rigs(intrinsics, observations, seed):
                if len(start.cameras) >= 2:
                    yield adjust(start, groups, radial=False, steps=_ROUGH)

    best = _best(attempts(), len(sizes))
    if best is None or len(best.cameras) < len(sizes):
        raise _unregistered(observations, sizes, best)
    best, left_out = _adjust_without_outliers(best, groups, settings)
    check_handedness(best)
    uncertain = uncertainty(best, groups, radial=settings.has_distortion)
    vague = [name for name in sizes if uncertain[name] > _VAGUE]
    if vague:
        problem = (
            f"the marks do not determine the position of {', '.join(vague)}: the points are collinear, too close "
            "together or too few"
        )
        fix = "Mark more points, spread over the image and in depth."
        raise StudioError("tie_points.degenerate", problem, value=vague, fix=fix, cameras=vague)
    progress(len(guesses) + 1, len(guesses) + 1)
    return _result(
        best,
        settings.known_distance,
        sizes,
        left_out=left_out,
        known_intrinsics=[name for name in sizes if name in known],
        uncertain={name: round(uncertain[name], 4) for name in sizes},
    )


def _in_views(
    pixels: Mapping[str, tuple[float, float]], wide: Mapping[str, Camera], views: Mapping[str, Camera]
) -> dict[str, tuple[float, float]]:
    """The marks of a point, where those of fisheyes are in their pinhole views."""
    moved = dict(pixels)
    for name in wide.keys() & pixels.keys():
        ray = wide[name].normalized(np.array([pixels[name]]))[0]
        x, y = (ray * views[name].K[[0, 1], [0, 1]] + views[name].K[:2, 2]).tolist()
        moved[name] = (x, y)
    return moved


def _best(attempts: Iterable[TieRig], count: int) -> TieRig | None:
    """The first attempt with all cameras and a good fit; else the one with most cameras and least misfit."""
    best, rank = None, (0, -np.inf)
    for attempt in attempts:
        own = (len(attempt.cameras), -_misfit(attempt))
        if own > rank:
            best, rank = attempt, own
        if rank[0] == count and -rank[1] < _GOOD * MARK:
            break
    return best


def _observations(points: Sequence[TiePoint], sizes: Mapping[str, tuple[int, int]]) -> Observations:
    nothing = (np.nan, np.nan)
    used = [point for point in points if any(name in sizes for name in point.pixels)]
    for point in used:
        for name, (x, y) in point.pixels.items():
            if name in sizes and not (0 <= x <= sizes[name][0] and 0 <= y <= sizes[name][1]):
                raise StudioError(
                    "tie_points.outside",
                    f"point '{point.name}' is marked at ({x:g}, {y:g}) in {name}, outside its image of "
                    f"{sizes[name][0]}x{sizes[name][1]}",
                    value=[x, y],
                    fix="Mark it again in images of that size.",
                    point=point.name,
                    camera=name,
                    expected=list(sizes[name]),
                )
    if not used:
        problem = f"no tie point is marked in any of the cameras {', '.join(sizes)}"
        fix = "Mark points in the images of these cameras."
        raise StudioError("tie_points.none", problem, fix=fix, expected=list(sizes))
    return Observations(
        [point.name for point in used],
        np.array([point.world if point.world is not None else (np.nan,) * 3 for point in used], np.float64),
        {name: np.array([point.pixels.get(name, nothing) for point in used], np.float64) for name in sizes},
    )


def _groups(free: Sequence[str], sizes: Mapping[str, tuple[int, int]], shared: bool | None) -> list[list[str]]:
    if shared is False:
        return [[name] for name in free]
    return [[name for name in free if sizes[name] == size] for size in dict.fromkeys(sizes[name] for name in free)]


def _misfit(rig: TieRig) -> float:
    """Mean reprojection error in pixels, each clipped at 1% of the longer image side."""
    errors = rig.errors()
    limits = {name: 0.01 * max(camera.width, camera.height) for name, camera in rig.cameras.items()}
    every = np.concatenate([np.minimum(error[~np.isnan(error)], limits[name]) for name, error in errors.items()])
    return float(every.mean()) if len(every) else np.inf


def _adjust_without_outliers(
    rig: TieRig, groups: list[list[str]], settings: CalibrateSettings
) -> tuple[TieRig, list[RejectedMark]]:
    """Bundle adjustment with outlier rejection, one mark at a time, the worst first."""
    observations = rig.observations
    left_out: list[RejectedMark] = []
    while True:
        rig = adjust(rig, groups, radial=settings.has_distortion)
        errors = rig.errors()
        check_plausible(rig)
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
        off = float(errors[name][number])  # infinite behind the camera
        rounded = round(off, 2) if np.isfinite(off) else None
        left_out.append(RejectedMark(point=observations.points[number], camera=name, error=rounded))
        observations.pixels[name][number] = np.nan
        seen_by = sum(bool(observations.seen(other)[number]) for other in rig.cameras)
        if seen_by < 2 and not observations.measured[number]:
            for other in rig.cameras:
                observations.pixels[other][number] = np.nan
            rig.points3d[number] = np.nan
        if int(observations.seen(name).sum()) < LEAST_KNOWN:
            raise StudioError(
                "tie_points.inconsistent",
                f"camera '{name}': its marks are not consistent with those of the other cameras; the largest errors "
                f"are those of {', '.join(mark.point for mark in left_out)}",
                value=[mark.point for mark in left_out],
                fix="Check these marks, or mark more points.",
                camera=name,
            )


def _unregistered(observations: Observations, sizes: Mapping[str, tuple[int, int]], best: TieRig | None) -> StudioError:
    """The error for cameras that cannot be registered; it states what is missing."""
    registered = [name for name in sizes if name in best.cameras] if best is not None else []
    lost = [name for name in sizes if name not in registered]
    marks = {name: int(observations.seen(name).sum()) for name in sizes}
    measured = {name: int((observations.seen(name) & observations.measured).sum()) for name in sizes}
    if best is None or not registered:
        counts = ", ".join(f"{name} {marks[name]} ({measured[name]} measured)" for name in sizes)
        problem = f"the marks do not determine the relative pose of any two cameras; marks per camera: {counts}"
        fix = (
            f"Mark at least {LEAST_SHARED} points, not all collinear, in two cameras, or {LEAST_KNOWN} measured "
            "points per camera."
        )
        return StudioError("tie_points.unregistered", problem, value=lost, fix=fix, cameras=lost, marks=marks)
    name = lost[0]
    known = int((observations.seen(name) & best.triangulated).sum())
    problem = (
        f"not registered: {', '.join(lost)}; camera '{name}' sees {known} of the points triangulated from "
        f"{', '.join(registered)}, expected at least {LEAST_KNOWN} that fit"
    )
    fix = "Mark more points that are visible in both these and the registered cameras."
    return StudioError("tie_points.unregistered", problem, value=lost, fix=fix, camera=name, cameras=lost, marks=marks)


def _result(
    rig: TieRig,
    distance: tuple[str, str, float] | None,
    sizes: Mapping[str, tuple[int, int]],
    **more: Any,
) -> CalibrationResult:
    """The result in world coordinates; `more`: further fields of the report."""
    observations = rig.observations
    cameras = Rig(tuple(rig.cameras[name] for name in sizes))
    kept = np.flatnonzero(rig.triangulated)
    points3d, world = rig.points3d[kept], observations.world[kept]
    measured = ~np.isnan(world[:, 0])
    metric = False
    if measured.sum() > 2:  # they must not be collinear
        metric = np.linalg.matrix_rank(world[measured] - world[measured].mean(0), rtol=1e-3) > 1
    if metric:
        similarity = align_points(points3d[measured], world[measured])
    else:
        similarity = upright(cameras, points3d)
    cameras, points3d = similarity.rig(cameras), similarity.points(points3d)
    if distance is not None and not metric:
        scaling = scale_to_distance(cameras, *distance)
        cameras, points3d = scaling.rig(cameras), scaling.points(points3d)
    by_camera = {}
    for name in sizes:
        seen = observations.seen(name)[kept]
        by_camera[name] = np.column_stack([np.flatnonzero(seen), observations.pixels[name][kept][seen]])
    report = reprojection_report(
        cameras,
        points3d,
        by_camera,
        tie_points=_figures(cameras, points3d, by_camera, [observations.points[k] for k in kept], world),
        metric=bool(metric or distance is not None),
        **more,
    )
    return CalibrationResult(cameras, points3d, np.full((len(points3d), 3), 255, np.uint8), report)


def _figures(
    rig: Rig, points3d: np.ndarray, observations: dict[str, np.ndarray], names: list[str], world: np.ndarray
) -> dict[str, TiePointReport]:
    errors, counts = np.zeros(len(names)), np.zeros(len(names), int)
    for camera in rig:
        rows = observations[camera.name]
        index = rows[:, 0].astype(int)
        errors[index] += np.linalg.norm(camera.project(points3d[index])[0] - rows[:, 1:], axis=1)
        counts[index] += 1
    reports = {}
    for name, error, count, point, measured in zip(names, errors, counts, points3d, world, strict=True):
        off = {} if np.isnan(measured[0]) else {"off": round(float(np.linalg.norm(point - measured)), 5)}
        mean = round(float(error / count), 3) if count else None
        reports[name] = TiePointReport(cameras=int(count), error=mean, **off)
    return reports
