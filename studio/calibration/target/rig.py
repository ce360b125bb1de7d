"""Cameras of a rig from pictures of a calibration board: lenses, places, scale, and how good they are."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from studio.calibration.alignment import Similarity, upright
from studio.calibration.result import CalibrationResult, image_coverage, reprojection_report
from studio.calibration.settings import CalibrateSettings
from studio.calibration.target.bundle_adjustment import TargetRig
from studio.calibration.target.intrinsics import check_lens_size, lens_from_views
from studio.calibration.target.outlier_rejection import settle
from studio.calibration.target.pattern import CalibrationTarget, TargetObservation
from studio.calibration.target.pose_graph import chain
from studio.calibration.target.scale_accuracy import scale_check, shared_sync_frames
from studio.cameras import Camera, Rig
from studio.errors import StudioError
from studio.progress import ProgressFn, no_progress

_OUTLIER = 4.0
"""Views whose error is this many times that against a target pose of their own, and above half a pixel, are left out:
the target moved, and the cameras are not exactly synchronized."""

_COVERED = 0.6
"""Fraction of the image that views must cover for the principal point to be estimated: with less, a shifted principal
point cannot be told from a rotated camera."""


def _estimates_principal_point(
    settings: CalibrateSettings, views: Sequence[TargetObservation], size: tuple[int, int]
) -> bool:
    if settings.refine_principal_point:
        return True
    return image_coverage(np.concatenate([view.pixels for view in views]), size) >= _COVERED


def detect_target(
    cameras: Mapping[str, Callable[[int], np.ndarray]],
    sync_frames: Mapping[str, Sequence[int]],
    board: CalibrationTarget,
    progress: ProgressFn = no_progress,
) -> tuple[dict[tuple[int, str], TargetObservation], dict[str, tuple[int, int]]]:
    """Look for the board in every picture.

    Args:
        cameras: name to a function that reads the picture (H, W, 3) uint8 RGB of a moment.
        sync_frames: name to the moments to read.
        board: what to look for.
        progress: called for every picture.

    Returns:
        (moment, camera) to view, and width and height of each camera's pictures.

    Raises:
        StudioError: pictures of one camera differ in size.
    """
    views: dict[tuple[int, str], TargetObservation] = {}
    sizes: dict[str, tuple[int, int]] = {}
    total, done = sum(len(sync_frames[name]) for name in cameras), 0
    for name, read in cameras.items():
        for sync_frame in sync_frames[name]:
            progress(done, total, found=len(views))
            image = read(sync_frame)
            size = (image.shape[1], image.shape[0])
            if sizes.setdefault(name, size) != size:
                raise StudioError(
                    f"Camera '{name}': the picture of moment {sync_frame} is {size[0]}x{size[1]}, earlier ones are "
                    f"{sizes[name][0]}x{sizes[name][1]}; take pictures of one size."
                )
            view = board.detect(image)
            if view is not None:
                views[sync_frame, name] = view
            done += 1
    progress(total, total, found=len(views))
    return views, sizes


def calibrate_lenses(
    board: CalibrationTarget,
    views: Mapping[str, Sequence[TargetObservation]],
    sizes: Mapping[str, tuple[int, int]],
    settings: CalibrateSettings | None = None,
    threads: int = 0,
) -> tuple[dict[str, Camera], dict[str, dict[str, Any]]]:
    """Lenses alone, each camera by its own pictures of the board, which need not be of common moments.

    Returns:
        name to camera at the identity pose, and name to figures: `mean`, `median`, `p95` of the reprojection errors in
        pixels, `views`.

    Raises:
        StudioError: a camera sees the board too seldom.
    """
    settings = settings or CalibrateSettings()
    cameras, figures = {}, {}
    for name, seen in views.items():
        principal_point = bool(seen) and _estimates_principal_point(settings, seen, sizes[name])
        start = lens_from_views(name, sizes[name], board, seen, settings.camera_model, principal_point=principal_point)
        state = chain({name: start}, board, {(number, name): view for number, view in enumerate(seen)})
        if not state.views:
            raise StudioError(f"Camera '{name}': none of its {len(seen)} pictures of the board fits a lens.")
        state, _ = _settle(state, board, settings, {}, principal_point, threads)
        cameras[name] = state.cameras[name]
        errors = np.concatenate(list(state.errors(board).values()))
        figures[name] = {
            "mean": round(float(errors.mean()), 4),
            "median": round(float(np.median(errors)), 4),
            "p95": round(float(np.quantile(errors, 0.95)), 4),
            "views": len(state.views),
        }
    return cameras, figures


def calibrate_from_target(
    board: CalibrationTarget,
    views: Mapping[tuple[int, str], TargetObservation],
    sizes: Mapping[str, tuple[int, int]],
    *,
    known: Mapping[str, Camera] | None = None,
    settings: CalibrateSettings | None = None,
    threads: int = 0,
    progress: ProgressFn = no_progress,
) -> CalibrationResult:
    """Lenses and places of all cameras.

    Args:
        board: what was filmed.
        views: (moment, camera) to what was seen; moments are common to all cameras.
        sizes: width and height of each camera's pictures; names all cameras.
        known: cameras whose lenses are known and stay as they are; their poses are not used.
        settings: how to solve.
        threads: CPU threads; 0: all cores.
        progress: of the steps.

    Returns:
        cameras in meters; the points are the board's corners at all moments. The report has, beside
        `reprojection_report`'s figures, `boards`: moments, views and corners used, views and corners left out, and what
        (see `scale_accuracy.scale_check`), and `unregistered` (empty).

    Raises:
        StudioError: a camera never sees the board, or never together with another; an origin without a board.
    """
    settings = settings or CalibrateSettings()
    known = dict(known or {})
    if board.is_symmetric:
        raise StudioError(
            f"A chessboard of {board.columns} x {board.rows} squares looks the same upside down, so cameras cannot "
            "agree on where it stands; use one with an odd and an even number of squares, or a ChArUco board."
        )
    lenses: dict[str, Camera] = {}
    estimated: dict[str, bool] = {}
    for number, (name, size) in enumerate(sizes.items()):
        progress(number, 2 * len(sizes) + 3)
        own = [view for (_, camera), view in views.items() if camera == name]
        if not own:
            raise StudioError(
                f"Camera '{name}' sees the board in none of its pictures; check the board's description (columns, "
                "rows, dictionary, inverted), or film it nearer."
            )
        if name in known:
            check_lens_size(known[name], size)
            lenses[name] = known[name]
        else:
            estimated[name] = _estimates_principal_point(settings, own, size)
            lenses[name] = lens_from_views(
                name, size, board, own, settings.camera_model, principal_point=estimated[name]
            )
    progress(len(sizes), 2 * len(sizes) + 3)
    state = chain(lenses, board, views)
    progress(2 * len(sizes), 2 * len(sizes) + 3)
    state, dropped = _settle(state, board, settings, known, all(estimated.values()), threads)
    progress(2 * len(sizes) + 2, 2 * len(sizes) + 3)
    result = _result(state, board, settings)
    result.report["boards"] = {
        "sync_frames": len(state.boards),
        "views": len(state.views),
        "corners": sum(len(view.ids) for view in state.views.values()),
        "views_left_out": len(views) - len(state.views),
        "corners_left_out": dropped,
        "shared": shared_sync_frames(state),
        **scale_check(state, board),
    }
    result.report |= {"unregistered": {}, "metric": True}
    progress(2 * len(sizes) + 3, 2 * len(sizes) + 3)
    return result


def _settle(
    state: TargetRig,
    board: CalibrationTarget,
    settings: CalibrateSettings,
    known: Mapping[str, Camera],
    principal_point: bool,
    threads: int,
) -> tuple[TargetRig, int]:
    return settle(
        state,
        board,
        settings.camera_model,
        _OUTLIER,
        known=known,
        principal_point=principal_point,
        threads=threads or os.cpu_count() or 1,
    )


def _result(state: TargetRig, board: CalibrationTarget, settings: CalibrateSettings) -> CalibrationResult:
    """Everything in the world's coordinates."""
    order = {sync_frame: number for number, sync_frame in enumerate(state.boards)}
    count = len(board.corners)
    points = np.concatenate([board.corners @ p[:3, :3].T + p[:3, 3] for p in state.boards.values()])
    observations: dict[str, np.ndarray] = {}
    for name in state.cameras:
        seen_by = [
            np.column_stack([order[sync_frame] * count + view.ids, view.pixels])
            for (sync_frame, camera), view in state.views.items()
            if camera == name
        ]
        observations[name] = np.concatenate(seen_by)
    rig = Rig(tuple(state.cameras.values()))
    if settings.board_origin is not None:
        if settings.board_origin not in state.boards:
            near = min(state.boards, key=lambda sync_frame: abs(sync_frame - int(settings.board_origin or 0)))
            raise StudioError(
                f"Frame {settings.board_origin} should give the origin, but no camera sees the board there; the "
                f"nearest frame in which one does is {near}."
            )
        world = target_world(board, state.boards[settings.board_origin], upright=settings.board_upright)
    else:
        world = upright(rig, points, keep_scale=True)
    rig, points = world.rig(rig), world.points(points)
    seen = np.unique(np.concatenate([rows[:, 0] for rows in observations.values()]).astype(int))
    renumber = np.full(len(points), -1)
    renumber[seen] = np.arange(len(seen))
    for rows in observations.values():
        rows[:, 0] = renumber[rows[:, 0].astype(int)]
    report = reprojection_report(rig, points[seen], observations)
    return CalibrationResult(rig, points[seen], np.full((len(seen), 3), 255, np.uint8), report)


def target_world(board: CalibrationTarget, place: np.ndarray, *, upright: bool) -> Similarity:
    """The world that a board gives: origin in its middle, x along its columns, z up.

    Args:
        board: the board.
        place: (4, 4) from board coordinates to the present ones.
        upright: see `CalibrateSettings`.
    """
    x, y, z = place[:3, :3].T
    rotation = np.stack([x, z, -y]) if upright else np.stack([x, -y, -z])
    middle = place[:3, :3] @ board.middle + place[:3, 3]
    return Similarity(1.0, rotation, -rotation @ middle)
