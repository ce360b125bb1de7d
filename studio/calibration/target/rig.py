"""Calibration of a rig from images of a calibration target: intrinsics, poses, scale and report."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from v3studio.studio.calibration.alignment import align_points, upright
from v3studio.studio.calibration.report import IntrinsicsReport, TargetReport
from v3studio.studio.calibration.result import CalibrationResult, error_statistics, image_coverage, reprojection_report
from v3studio.studio.calibration.settings import CalibrateSettings
from v3studio.studio.calibration.target.bundle_adjustment import TargetRig
from v3studio.studio.calibration.target.intrinsics import intrinsics_from_views
from v3studio.studio.calibration.target.outlier_rejection import refine_without_outliers
from v3studio.studio.calibration.target.pattern import CalibrationTarget, TargetObservation
from v3studio.studio.calibration.target.pose_graph import chain_poses
from v3studio.studio.cameras import Camera, Rig, nearest_point_to_rays
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.similarity import Similarity

_COVERED = 0.6
"""Fraction of the image that views must cover for the principal point to be estimated: with less, a shifted principal
point cannot be distinguished from a rotated camera."""


def _start(
    name: str, size: tuple[int, int], views: Sequence[TargetObservation], settings: CalibrateSettings
) -> tuple[Camera, bool]:
    """Initial intrinsics of a camera, and whether its principal point is estimated."""
    covered = bool(views) and image_coverage(np.concatenate([view.pixels for view in views]), size) >= _COVERED
    return intrinsics_from_views(name, size, views, settings.camera_model, principal_point=covered), covered


def detect_target(
    cameras: Mapping[str, Callable[[int], np.ndarray]],
    sync_frames: Mapping[str, Sequence[int]],
    target: CalibrationTarget,
    progress: ProgressFn = no_progress,
) -> tuple[dict[tuple[int, str], TargetObservation], dict[str, tuple[int, int]]]:
    """Detect the target in every image; `progress` is called per image.

    Args:
        cameras: name to a function that reads the image (H, W, 3) uint8 RGB of a sync frame.
        sync_frames: name to the sync frames to read.

    Returns:
        (sync frame, camera) to observation, and (width, height) of each camera's images.

    Raises:
        StudioError: the images of a camera differ in size (target.image_size).
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
                    "target.image_size",
                    f"camera '{name}': the image of frame {sync_frame} is {size[0]}x{size[1]}, earlier ones are "
                    f"{sizes[name][0]}x{sizes[name][1]}",
                    value=list(size),
                    fix="Use images of one size per camera.",
                    camera=name,
                    frame=sync_frame,
                    expected=list(sizes[name]),
                )
            view = target.detect(image)
            if view is not None:
                views[sync_frame, name] = view
            done += 1
    progress(total, total, found=len(views))
    return views, sizes


def calibrate_intrinsics(
    views: Mapping[str, Sequence[TargetObservation]],
    sizes: Mapping[str, tuple[int, int]],
    settings: CalibrateSettings | None = None,
    threads: int = 0,
) -> tuple[dict[str, Camera], dict[str, IntrinsicsReport]]:
    """Intrinsics of each camera, at the identity pose, and a report, by name, from its own images of the target, which
    need not be synchronized. StudioError if a camera has too few observations (target.too_few_views), or they do not
    determine its intrinsics (target.focal_length, target.no_fit)."""
    settings = settings or CalibrateSettings()
    cameras, figures = {}, {}
    for name, seen in views.items():
        start, principal_point = _start(name, sizes[name], seen, settings)
        state = chain_poses({name: start}, {(number, name): view for number, view in enumerate(seen)})
        state = refine_without_outliers(state, settings.camera_model, principal_point=principal_point, threads=threads)
        cameras[name] = state.cameras[name]
        errors = np.concatenate(list(state.errors().values()))
        figures[name] = IntrinsicsReport(**error_statistics(errors).model_dump(), views=len(state.views))
    return cameras, figures


def calibrate_from_target(
    target: CalibrationTarget,
    views: Mapping[tuple[int, str], TargetObservation],
    sizes: Mapping[str, tuple[int, int]],
    *,
    settings: CalibrateSettings | None = None,
    threads: int = 0,
    progress: ProgressFn = no_progress,
) -> CalibrationResult:
    """Estimate intrinsics and poses of all cameras.

    Args:
        views: (sync frame, camera) to observation.
        sizes: camera name to (width, height) of its images, for all cameras to calibrate.
        threads: number of threads, 0 = all cores.
        progress: called per step.

    Returns:
        cameras in meters; the points are the corners of the target in all sync frames. The report contains `target`.

    Raises:
        StudioError: the target is symmetric (target.symmetric), a camera never sees it (target.not_seen) or never in
            the same sync frame as another camera (target.not_connected), no observation fits the target
            (target.no_fit), or no camera sees it in the origin frame (target.origin).
    """
    settings = settings or CalibrateSettings()
    if target.is_symmetric:
        raise StudioError(
            "target.symmetric",
            f"a chessboard of {target.columns} x {target.rows} squares looks the same upside down, so its orientation "
            "is ambiguous",
            value=[target.columns, target.rows],
            fix="Use an even number of squares in one direction and an odd one in the other, or a ChArUco target.",
            setting="calibrate.board",
        )
    intrinsics: dict[str, Camera] = {}
    principal_points: dict[str, bool] = {}
    for number, (name, size) in enumerate(sizes.items()):
        progress(number, 2 * len(sizes) + 3)
        own = [view for (_, camera), view in views.items() if camera == name]
        if not own:
            problem = f"the target was not detected in any image of camera '{name}'"
            fix = "Check calibrate.board (columns, rows, dictionary), or film the target closer."
            raise StudioError("target.not_seen", problem, fix=fix, camera=name, setting="calibrate.board")
        intrinsics[name], principal_points[name] = _start(name, size, own, settings)
    progress(len(sizes), 2 * len(sizes) + 3)
    state = chain_poses(intrinsics, views)
    progress(2 * len(sizes), 2 * len(sizes) + 3)
    state = refine_without_outliers(
        state, settings.camera_model, principal_point=all(principal_points.values()), threads=threads
    )
    progress(2 * len(sizes) + 2, 2 * len(sizes) + 3)
    figures = TargetReport(
        sync_frames=len(state.target_poses),
        views=len(state.views),
        views_left_out=len(views) - len(state.views),
        **_scale_check(state, target),
    )
    result = _result(state, target, settings, figures)
    progress(2 * len(sizes) + 3, 2 * len(sizes) + 3)
    return result


def _scale_check(state: TargetRig, target: CalibrationTarget) -> dict[str, float]:
    """Triangulate the corners with the calibrated cameras and compare them with the target: `scale_bias` and
    `corner_error_mm` of a `TargetReport`, the latter after a fit; neither if no two cameras see the same corners."""
    scales, squares = [], []
    for sync_frame in state.target_poses:
        rays: dict[int, list[tuple[Camera, np.ndarray]]] = {}
        for name, camera in state.cameras.items():
            view = state.views.get((sync_frame, name))
            if view is not None:
                for corner, pixel in zip(view.ids, view.pixels, strict=True):
                    rays.setdefault(int(corner), []).append((camera, pixel))
        several = {corner: seen for corner, seen in rays.items() if len(seen) > 1}
        if len(several) < 4:
            continue
        ids = sorted(several)
        if target.on_one_line(ids):
            continue
        true = target.corners[ids]
        measured = np.array([_triangulate(several[corner]) for corner in ids])
        fit = align_points(true, measured)
        scales.append(fit.scale)
        rest = measured - (fit.points(true) - fit.points(true).mean(0)) / fit.scale - measured.mean(0)
        squares.append((rest**2).sum(1))
    if not scales:
        return {}
    error = round(1000 * float(np.sqrt(np.concatenate(squares).mean())), 3)
    return {"scale_bias": round(float(np.mean(scales)) - 1, 6), "corner_error_mm": error}


def _triangulate(seen: list[tuple[Camera, np.ndarray]]) -> np.ndarray:
    """(3,): the point nearest to the rays through the pixels."""
    directions = np.concatenate([camera.ray_directions(pixel) for camera, pixel in seen])
    return nearest_point_to_rays(np.array([camera.center for camera, _ in seen]), directions)


def _result(
    state: TargetRig, target: CalibrationTarget, settings: CalibrateSettings, figures: TargetReport
) -> CalibrationResult:
    """The result in world coordinates."""
    order = {sync_frame: number for number, sync_frame in enumerate(state.target_poses)}
    count = len(target.corners)
    points = np.concatenate([target.corners @ p[:3, :3].T + p[:3, 3] for p in state.target_poses.values()])
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
        if settings.board_origin not in state.target_poses:
            near = min(state.target_poses, key=lambda sync_frame: abs(sync_frame - int(settings.board_origin or 0)))
            problem = f"no camera sees the target in frame {settings.board_origin}, which defines the origin"
            value = settings.board_origin
            fix = f"Set calibrate.board_origin to another frame; the nearest is {near}."
            raise StudioError(
                "target.origin", problem, value=value, fix=fix, setting="calibrate.board_origin", expected=near
            )
        world = target_world(target, state.target_poses[settings.board_origin], upright=settings.board_upright)
    else:
        world = upright(rig, points, keep_scale=True)
    rig, points = world.rig(rig), world.points(points)
    seen = np.unique(np.concatenate([rows[:, 0] for rows in observations.values()]).astype(int))
    for rows in observations.values():
        rows[:, 0] = np.searchsorted(seen, rows[:, 0])
    report = reprojection_report(rig, points[seen], observations, target=figures, metric=True)
    return CalibrationResult(rig, points[seen], np.full((len(seen), 3), 255, np.uint8), report)


def target_world(target: CalibrationTarget, pose: np.ndarray, *, upright: bool) -> Similarity:
    """World coordinates by a target with a (4, 4) pose: origin at its center, x along its rows, z up."""
    x, y, z = pose[:3, :3].T
    rotation = np.stack([x, z, -y]) if upright else np.stack([x, -y, -z])
    middle = pose[:3, :3] @ target.middle + pose[:3, 3]
    return Similarity(1.0, rotation, -rotation @ middle)
