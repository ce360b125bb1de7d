"""OpenCV's coefficients of Brown's lens model, of which OpenCV lacks the fourth radial term."""

from collections.abc import Callable, Sequence

import numpy as np

from v3studio.studio.validation import camera_error

_TOLERANCE = 0.25  # maximum allowed difference from the original model within the image, in pixels


def brown(k: Sequence[float], p: Sequence[float], K: np.ndarray, size: tuple[int, int], camera: str) -> np.ndarray:
    """OpenCV's coefficients, none for a pinhole camera, of four radial terms and p1, p2 in OpenCV's order.

    The radial terms multiply undistorted radii r in normalized coordinates by 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8. If
    k4 is not 0, OpenCV's rational model is fitted. K, (3, 3), and `size`, width and height, are in pixels.
    """
    if not k[3]:
        return np.array([k[0], k[1], *p, k[2]]) if any((*k, *p)) else np.zeros(0)
    from scipy.optimize import least_squares

    def radial(r: np.ndarray) -> np.ndarray:
        s = r * r
        return 1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))

    focal = float(min(K[0, 0], K[1, 1]))
    r = np.linspace(0, _reach_of(radial, focal, K[:2, 2], np.array(size)), 200)
    wanted = r * radial(r)

    def bend(k: np.ndarray) -> np.ndarray:
        s = r * r
        return r * (1 + s * (k[0] + s * (k[1] + s * k[2]))) / (1 + s * (k[3] + s * (k[4] + s * k[5])))

    # initial values from the linear problem numerator - denominator * factor = 0
    s, factor = r * r, radial(r)
    columns = np.column_stack([s, s**2, s**3, -s * factor, -(s**2) * factor, -(s**3) * factor]) * r[:, None]
    start = np.linalg.lstsq(columns, (factor - 1) * r, rcond=None)[0]
    fitted = least_squares(lambda k: focal * (bend(k) - wanted), start, method="lm", max_nfev=5000).x
    if np.abs(focal * (bend(fitted) - wanted)).max() > _TOLERANCE:
        fix = "Export the cameras with at most three radial terms, or undistort the images."
        raise camera_error("camera.lens_model", camera, "OpenCV's lens models cannot express its distortion", fix=fix)
    return np.array([*fitted[:2], *p, *fitted[2:]])


def _reach_of(radial: Callable[[np.ndarray], np.ndarray], focal: float, offset: np.ndarray, size: np.ndarray) -> float:
    """Largest undistorted radius in an image, in normalized coordinates. Focal length, (2,) principal point from the
    upper left corner, and (2,) size are in pixels."""
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * size - offset
    far = float(np.linalg.norm(corners, axis=1).max()) / focal
    r = np.linspace(0, 3 * far, 3000)
    beyond = np.flatnonzero(r * radial(r) >= far)
    return float(r[beyond[0]]) if len(beyond) else far
