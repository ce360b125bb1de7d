"""What a camera sees of the crop box."""

import numpy as np

from studio.cameras import Camera
from studio.edits.edit_list import CropBox


def silhouette(camera: Camera, box: CropBox) -> np.ndarray:
    """(H, W) bool: the pixels in which a pinhole camera sees the box; all if a corner is beside or behind it."""
    import cv2

    pixels, depth = camera.project(box.corners)
    seen = np.zeros((camera.height, camera.width), np.uint8)
    if depth.min() <= 1e-6:
        return np.ones_like(seen, dtype=bool)
    hull = cv2.convexHull((pixels - 0.5).astype(np.float32))
    if np.abs(hull).max() > 2**14:  # OpenCV draws coordinates below 2^15
        right, bottom = camera.width, camera.height
        image = np.array([[-1, -1], [right, -1], [right, bottom], [-1, bottom]], np.float32)
        _, clipped = cv2.intersectConvexConvex(hull, image)
        if clipped is None:
            return seen.astype(bool)
        hull = clipped
    cv2.fillConvexPoly(seen, np.round(hull).astype(np.int32), 1)
    return seen.astype(bool)
