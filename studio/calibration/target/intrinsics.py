"""Intrinsics of one camera from images of a calibration target, and target poses."""

from collections.abc import Sequence

import cv2
import numpy as np

from v3studio.studio.calibration.initial_intrinsics import may_be_fisheye
from v3studio.studio.calibration.settings import USUAL_MODEL
from v3studio.studio.calibration.target.pattern import TargetObservation
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError

MOST_VIEWS = 40  # maximum number of observations used for the initial estimate; bundle adjustment uses all
LEAST_VIEWS = 3
_ROUGH_VIEWS = 14  # for the initial estimate of a fisheye, whose time grows with their square
_BETTER = 0.9
"""Fraction of the usual lens's error below which a lens is a fisheye. It is not much less, since the pose of each view
makes up for a wrong lens: up to 50 degrees from the axis, a fisheye of 104 degrees had 0.73."""


def intrinsics_from_views(
    name: str, size: tuple[int, int], views: Sequence[TargetObservation], model: str | None, *, principal_point: bool
) -> Camera:
    """Initial intrinsics of a camera by Zhang's method (OpenCV), as a camera at the identity pose.

    From `views` at several positions and tilts; `model` as in `CalibrateSettings.camera_model`; `principal_point`:
    estimate it; otherwise it is the center of the image of (width, height) `size`.
    """
    if len(views) < LEAST_VIEWS:
        problem = (
            f"camera '{name}' sees the target in {len(views)} images, expected at least {LEAST_VIEWS} (20 recommended)"
        )
        fix = "Film the target longer, at different tilts, or specify known intrinsics."
        raise StudioError("target.too_few_views", problem, value=len(views), fix=fix, camera=name, expected=LEAST_VIEWS)
    chosen = most_different(views, size)
    usual = None
    try:
        if model != "OPENCV_FISHEYE":
            usual = _brown(name, size, chosen, model or USUAL_MODEL, principal_point)
    except StudioError:
        if model is not None:
            raise
    if usual is not None and (model is not None or not may_be_fisheye(usual.fx / max(size), usual.distortion)):
        return usual
    wide = _fisheye(name, size, chosen, principal_point)
    if usual is not None:
        return wide if wide is not None and _error(wide, chosen) < _BETTER * _error(usual, chosen) else usual
    if wide is None:
        raise _no_focal_length(name, size, len(views), 0.0)
    return wide


def _error(camera: Camera, views: Sequence[TargetObservation]) -> float:
    """RMS reprojection error in pixels, of each view at its own pose."""
    return float(np.sqrt(np.mean([target_pose(camera, view)[1] ** 2 for view in views])))


def _fisheye(
    name: str, size: tuple[int, int], views: Sequence[TargetObservation], principal_point: bool
) -> Camera | None:
    """The fisheye lens that fits best, from several initial focal lengths; None if OpenCV finds none."""
    some = [views[int(index)] for index in np.linspace(0, len(views) - 1, min(_ROUGH_VIEWS, len(views)))]
    world = [view.corners[None].astype(np.float64) for view in some]
    pixels = [view.pixels[None] - 0.5 for view in some]
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-6)
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
    flags |= cv2.CALIB_FIX_K3 | cv2.CALIB_FIX_K4  # which the bundle adjustment adds
    if not principal_point or len(views) < 6:
        flags |= cv2.CALIB_FIX_PRINCIPAL_POINT
    best, camera = np.inf, None
    for factor in (0.3, 0.45, 0.7):
        focal = factor * max(size)
        start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
        try:
            error, K, bend, _, _ = cv2.fisheye.calibrate(
                world, pixels, size, start, np.zeros((4, 1)), flags=flags, criteria=until
            )
        except cv2.error:  # it diverged
            continue
        if error < best and np.isfinite(K).all() and 0.1 < K[0, 0] / max(size) < 50:
            best, camera = error, Camera(name, *size, K + _HALF, np.eye(4), np.ravel(bend), fisheye=True)
    return camera


_HALF = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])


def _brown(
    name: str, size: tuple[int, int], chosen: Sequence[TargetObservation], model: str, principal_point: bool
) -> Camera:
    world = [view.corners.astype(np.float32) for view in chosen]
    pixels = [(view.pixels - 0.5).astype(np.float32) for view in chosen]
    flags = {
        "SIMPLE_PINHOLE": cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | _fix(1, 2, 3),
        "PINHOLE": cv2.CALIB_ZERO_TANGENT_DIST | _fix(1, 2, 3),
        "SIMPLE_RADIAL": cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | _fix(2, 3),
        "RADIAL": cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | _fix(3),
        "OPENCV": _fix(3),
        "FULL_OPENCV": cv2.CALIB_RATIONAL_MODEL,
    }[model]
    if not principal_point or len(chosen) < 6:  # a few views cannot separate principal point and rotation
        flags |= cv2.CALIB_FIX_PRINCIPAL_POINT
    K: np.ndarray = _first_guess(world, pixels, size)
    distortion: np.ndarray = np.zeros(8)
    # in stages: estimating all terms at once can end in a wrong local minimum
    steps = [flags | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST | _fix(2, 3), flags]
    for step in steps:
        step |= cv2.CALIB_USE_INTRINSIC_GUESS
        _, new_K, new_distortion, _, _ = cv2.calibrateCamera(world, pixels, size, K, distortion, flags=step)
        K, distortion = np.array(new_K, np.float64), np.array(new_distortion, np.float64)
    K[:2, 2] += 0.5
    coefficients = np.ravel(distortion)[: 8 if model == "FULL_OPENCV" else 4]
    if not np.isfinite(K).all() or not 0.1 < K[0, 0] / max(size) < 50:
        raise _no_focal_length(name, size, len(chosen), float(K[0, 0]))
    return Camera(name, *size, K, np.eye(4), coefficients if coefficients.any() else np.zeros(0))


def _no_focal_length(name: str, size: tuple[int, int], views: int, focal: float) -> StudioError:
    problem = (
        f"camera '{name}': {views} images of the target do not determine its focal length (found {focal:g} "
        f"pixels for images of {size[0]}x{size[1]})"
    )
    fix = "Film the target closer and tilted, or specify known intrinsics."
    return StudioError("target.focal_length", problem, value=focal, fix=fix, camera=name)


def _first_guess(world: Sequence[np.ndarray], pixels: Sequence[np.ndarray], size: tuple[int, int]) -> np.ndarray:
    """K of a pinhole camera: the best of several initial focal lengths."""
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_FIX_PRINCIPAL_POINT
        | cv2.CALIB_ZERO_TANGENT_DIST
        | _fix(1, 2, 3)
    )
    some = np.unique(np.linspace(0, len(world) - 1, min(12, len(world))).astype(int))
    best, guess = np.inf, np.eye(3)
    for factor in (0.5, 0.8, 1.2, 1.8, 3.0):
        focal = factor * max(size)
        start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
        error, K, _, _, _ = cv2.calibrateCamera(
            [world[i] for i in some], [pixels[i] for i in some], size, start, np.zeros(5), flags=flags
        )
        if error < best and 0.1 < K[0, 0] / max(size) < 50:
            best, guess = error, np.array(K)
    return guess


def _fix(*terms: int) -> int:
    return sum(getattr(cv2, f"CALIB_FIX_K{term}") for term in terms)


def most_different(views: Sequence[TargetObservation], size: tuple[int, int]) -> list[TargetObservation]:
    """Up to `MOST_VIEWS` observations that differ most in position, size and tilt (farthest-point sampling)."""
    if len(views) <= MOST_VIEWS:
        return list(views)
    marks = np.array([_mark(view, size) for view in views])
    chosen = [int(np.argmax([len(view.ids) for view in views]))]
    nearest = np.full(len(views), np.inf)
    while len(chosen) < MOST_VIEWS:
        nearest = np.minimum(nearest, np.linalg.norm(marks - marks[chosen[-1]], axis=1))
        nearest[chosen] = -1
        chosen.append(int(np.argmax(nearest)))
    return [views[index] for index in sorted(chosen)]


def _mark(view: TargetObservation, size: tuple[int, int]) -> np.ndarray:
    """Descriptor: position in the image, size and slant of the corners."""
    scaled = view.pixels / max(size)
    spread = np.cov(scaled.T)
    return np.concatenate([scaled.mean(0), np.sqrt(np.diag(spread)), [spread[0, 1] / np.sqrt(np.trace(spread) + 1e-9)]])


def target_pose(camera: Camera, view: TargetObservation) -> tuple[np.ndarray, float]:
    """(4, 4) pose, target to camera, and the RMS reprojection error in pixels. A planar target has two poses (Collins
    and Bartoli 2014); the pose with the smaller error is returned."""
    world = view.corners
    coefficients = camera.distortion if camera.distortion.size else None
    K, pixels = camera.cv2_K, (view.pixels - 0.5).reshape(-1, 1, 2)
    if camera.fisheye:  # as seen by a pinhole camera of focal length 1
        K, coefficients, pixels = np.eye(3), None, camera.normalized(view.pixels).reshape(-1, 1, 2)
        if not np.isfinite(pixels).all():
            return np.eye(4), np.inf
    count, turns, shifts, _ = cv2.solvePnPGeneric(world, pixels, K, coefficients, flags=cv2.SOLVEPNP_IPPE)
    best, pose = np.inf, np.eye(4)
    for index in range(int(count)):
        turn, shift = cv2.solvePnPRefineLM(world, pixels, K, coefficients, turns[index], shifts[index])
        candidate = np.vstack([np.column_stack([cv2.Rodrigues(turn)[0], shift]), [0, 0, 0, 1]])
        error = float(np.sqrt((view.errors(camera, candidate) ** 2).mean()))
        if error < best and candidate[2, 3] > 0:
            best, pose = error, candidate
    return pose, best
