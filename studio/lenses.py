"""Lens models: where lenses draw what a pinhole camera has at x / z, y / z.

Fisheye lenses follow Kannala and Brandt (2006), as OpenCV's `fisheye`, with the tangential and thin prism terms of
COLMAP's THIN_PRISM_FISHEYE. A direction at the angle theta from the axis is first drawn at the radius theta. Its
place (u, v) there, with s = u^2 + v^2, is then multiplied by 1 + k1 s + k2 s^2 + k3 s^3 + k4 s^4, and shifted.
"""

import numpy as np

THIN_PRISM = [0, 1, 4, 5, 2, 3, 6, 7]
"""COLMAP's order k1 k2 p1 p2 k3 k4 sx1 sy1 of a fisheye's coefficients, and back; here it is k1 k2 k3 k4
[p1 p2 s1 s2]."""
_STEPS = 30  # of the iterations that invert the model; they converge in less than ten within usual images


def distorted(points: np.ndarray, coefficients: np.ndarray, fisheye: bool) -> np.ndarray:
    """(N, 2) places in the image, in focal lengths from the principal point, of (N, 2) `points` x / z, y / z.
    `coefficients`: `Camera.distortion`, not empty."""
    if fisheye:
        return _fisheye_distorted(points, coefficients)
    if not len(points):
        return points  # for none, OpenCV returns None
    import cv2

    rays = np.column_stack([points, np.ones(len(points))])
    return np.asarray(cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), coefficients)[0].reshape(-1, 2))


def fisheye_undistorted(points: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Invert `distorted` for a fisheye; NaN for directions at 90 degrees from the axis or more, and where it has no
    inverse."""
    straight = np.asarray(points, np.float64)
    for _ in range(_STEPS if np.any(coefficients[4:]) else 1):
        straight = _with_angles(points - _shift(straight, coefficients), coefficients)
    theta = np.linalg.norm(straight, axis=-1, keepdims=True)
    result = straight * np.where(theta > 1e-9, np.tan(theta) / np.maximum(theta, 1e-9), 1.0)
    off = np.abs(_fisheye_distorted(result, coefficients) - points).max(-1, keepdims=True)
    return np.where((theta < np.pi / 2) & (off < 1e-6), result, np.nan)


def _fisheye_distorted(points: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    radius = np.linalg.norm(points, axis=-1, keepdims=True)
    straight = points * np.where(radius > 1e-9, np.arctan(radius) / np.maximum(radius, 1e-9), 1.0)
    bent: np.ndarray = straight * _stretch((straight**2).sum(-1, keepdims=True), coefficients)
    return bent + _shift(straight, coefficients)


def _with_angles(points: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """The places that `_stretch` moves to `points`, by Newton's method along each radius."""
    wanted = np.linalg.norm(points, axis=-1, keepdims=True)
    k1, k2, k3, k4 = coefficients[:4]
    theta = np.minimum(wanted, 1.0)
    for _ in range(_STEPS):
        s = theta**2
        slope = 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)))
        step = (theta * _stretch(s, coefficients) - wanted) / np.where(np.abs(slope) > 1e-3, slope, 1e-3)
        theta = np.clip(theta - np.clip(step, -0.5, 0.5), 0, np.pi)
    return points * np.where(wanted > 1e-9, theta / np.maximum(wanted, 1e-9), 1.0)


def _stretch(s: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    k1, k2, k3, k4 = coefficients[:4]
    stretch: np.ndarray = 1 + s * (k1 + s * (k2 + s * (k3 + s * k4)))
    return stretch


def _shift(straight: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    if not np.any(coefficients[4:]):
        return np.zeros_like(straight)
    p1, p2, s1, s2 = coefficients[4:]
    u, v = straight[..., 0], straight[..., 1]
    s = u * u + v * v
    return np.stack(
        [2 * p1 * u * v + p2 * (s + 2 * u * u) + s1 * s, 2 * p2 * u * v + p1 * (s + 2 * v * v) + s2 * s], axis=-1
    )
