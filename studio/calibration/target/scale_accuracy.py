"""How well a rig that was calibrated before a board measures that board."""

from __future__ import annotations

import numpy as np

from studio.calibration.alignment import align_points
from studio.calibration.target.bundle_adjustment import TargetRig
from studio.calibration.target.pattern import CalibrationTarget
from studio.cameras import Camera


def shared_sync_frames(state: TargetRig) -> dict[str, int]:
    """How many moments each pair of cameras shares."""
    sync_frames: dict[str, set[int]] = {name: set() for name in state.cameras}
    for sync_frame, name in state.views:
        sync_frames[name].add(sync_frame)
    names = list(state.cameras)
    return {
        f"{a} {b}": len(sync_frames[a] & sync_frames[b])
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if sync_frames[a] & sync_frames[b]
    }


def scale_check(state: TargetRig, board: CalibrationTarget) -> dict[str, float]:
    """The board measured with the calibrated cameras: its corners triangulated freely, then compared with the board.

    Returns:
        `scale_bias`: how much longer the measured distances between corners are than the board's, in parts (0.001 is
        one millimeter a meter); `corner_error_mm`: root mean square of the triangulated corners' distances from the
        board fitted to them. Empty where no corner is seen by two cameras.
    """
    scales, squares = [], []
    for sync_frame in state.boards:
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
        measured = np.array([_triangulate(several[corner]) for corner in ids])
        true = board.corners[ids]
        if np.linalg.matrix_rank(true - true.mean(0), tol=0.1 * board.square) < 2:
            continue
        fit = align_points(true, measured)
        scales.append(fit.scale)
        rest = measured - (fit.points(true) - fit.points(true).mean(0)) / fit.scale - measured.mean(0)
        squares.append((rest**2).sum(1))
    if not scales:
        return {}
    return {
        "scale_bias": round(float(np.mean(scales)) - 1, 6),
        "corner_error_mm": round(1000 * float(np.sqrt(np.concatenate(squares).mean())), 3),
    }


def _triangulate(seen: list[tuple[Camera, np.ndarray]]) -> np.ndarray:
    """(3,): the point nearest, in least squares, to the rays."""
    import cv2

    total, right = np.zeros((3, 3)), np.zeros(3)
    for camera, pixel in seen:
        lens = camera.distortion if camera.distortion.size else None
        flat = cv2.undistortPoints((pixel - 0.5).reshape(1, 1, 2), camera.cv2_K, lens).reshape(2)
        ray = np.array([*flat, 1.0]) @ camera.rotation
        ray /= np.linalg.norm(ray)
        projector = np.eye(3) - np.outer(ray, ray)
        total += projector
        right += projector @ camera.center
    return np.linalg.solve(total, right)
