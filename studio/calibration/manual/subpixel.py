"""Subpixel refinement of a click near a corner or a dot."""

import cv2
import numpy as np

_TURNS = 8


def snap(image: np.ndarray, x: float, y: float, radius: int = 6) -> tuple[float, float]:
    """The corner or dot center nearest to a click at (x, y), in pixels of a (H, W, 3) or (H, W) uint8 image.

    Förstner and Gülch (1987): around a corner the gradients are perpendicular to the direction to it, around a dot
    center they are parallel; the better fit is used. If neither is found within the radius, the click is returned
    unchanged.
    """
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    fits = [place for place in (_fit(gray, x, y, radius, dot) for dot in (False, True)) if place is not None]
    if not fits:
        return x, y
    best = min(fits, key=lambda place: place[2])
    return best[0], best[1]


def _fit(gray: np.ndarray, x: float, y: float, radius: int, dot: bool) -> tuple[float, float, float] | None:
    """A corner or dot center with its residual (0 to 1); None if the search leaves the radius."""
    here: np.ndarray = np.array([x, y], np.float64)
    cost = 1.0
    for _ in range(_TURNS):
        column, row = int(np.floor(here[0])), int(np.floor(here[1]))
        left, top = column - radius - 1, row - radius - 1
        patch = gray[max(top, 0) : row + radius + 2, max(left, 0) : column + radius + 2].astype(np.float64)
        if min(patch.shape) < 2 * radius + 3:
            return None  # at the image border
        down, right = (np.asarray(each) for each in np.gradient(patch))
        gx, gy = right[1:-1, 1:-1].ravel(), down[1:-1, 1:-1].ravel()
        rows, columns = np.mgrid[top + 1 : row + radius + 1, left + 1 : column + radius + 1] + 0.5
        offset = np.stack([columns.ravel() - here[0], rows.ravel() - here[1]], 1)
        weight = np.exp(-0.5 * (offset**2).sum(1) / (0.5 * radius) ** 2)
        # lines through the pixels: along the gradient for a dot, perpendicular to it for a corner
        normal = np.stack([-gy, gx] if dot else [gx, gy], 1)
        normals = np.einsum("n,ni,nj->ij", weight, normal, normal)
        eigenvalues = np.linalg.eigvalsh(normals)
        if eigenvalues[0] < 0.02 * eigenvalues[1] or eigenvalues[1] <= 0 or eigenvalues.sum() < 40 * weight.sum():
            return None  # flat, or an edge: one direction is undetermined
        distance = (normal * offset).sum(1)
        step: np.ndarray = np.linalg.solve(normals, (weight * distance) @ normal)
        here = here + step
        if np.abs(here - (x, y)).max() > radius:
            return None
        missed = (normal * (offset - step)).sum(1)
        spread = (normal**2).sum(1) * (offset**2).sum(1)
        cost = float((weight * missed**2).sum() / max((weight * spread).sum(), 1e-12))
        if np.abs(step).max() < 0.01:
            break
    return float(here[0]), float(here[1]), cost
