"""Accuracy of a calibrated rig's scale, measured on the target."""

import numpy as np

from studio.calibration.alignment import align_points
from studio.calibration.target.bundle_adjustment import TargetRig
from studio.calibration.target.pattern import CalibrationTarget
from studio.cameras import Camera, nearest_point_to_rays


def scale_check(state: TargetRig, target: CalibrationTarget) -> dict[str, float]:
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
