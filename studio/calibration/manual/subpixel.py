"""From a click near a corner or a dot to its exact place."""

from __future__ import annotations

import numpy as np

_TURNS = 8


def snap(image: np.ndarray, x: float, y: float, radius: int = 6) -> tuple[float, float]:
    """The corner or the middle of the dot that lies nearest to a click, to a fraction of a pixel.

    Förstner and Gülch (1987): at a corner all gradients around are square to the way to it, at a dot's middle they
    point along it; whichever fits better. Where there is neither within the radius the click stays as it is.

    Args:
        image: (H, W, 3) or (H, W) uint8.
        x, y: pixels, origin at the image's corner.
        radius: pixels to look around.

    Returns:
        (x, y) in the same pixels.
    """
    import cv2

    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found = [place for place in (_fit(gray, x, y, radius, dot) for dot in (False, True)) if place is not None]
    if not found:
        return x, y
    best = min(found, key=lambda place: place[2])
    return best[0], best[1]


def _fit(gray: np.ndarray, x: float, y: float, radius: int, dot: bool) -> tuple[float, float, float] | None:
    """A corner or a dot's middle, and how badly it fits (0 to 1); None where the search leaves the radius."""
    here: np.ndarray = np.array([x, y], np.float64)
    cost = 1.0
    for _ in range(_TURNS):
        column, row = int(np.floor(here[0])), int(np.floor(here[1]))
        left, top = column - radius - 1, row - radius - 1
        patch = gray[max(top, 0) : row + radius + 2, max(left, 0) : column + radius + 2].astype(np.float64)
        if min(patch.shape) < 2 * radius + 3:
            return None  # at the image's edge
        down, right = (np.asarray(each) for each in np.gradient(patch))
        gx, gy = right[1:-1, 1:-1].ravel(), down[1:-1, 1:-1].ravel()
        rows, columns = np.mgrid[top + 1 : row + radius + 1, left + 1 : column + radius + 1] + 0.5
        offset = np.stack([columns.ravel() - here[0], rows.ravel() - here[1]], 1)
        weight = np.exp(-0.5 * (offset**2).sum(1) / (0.5 * radius) ** 2)
        # lines through the pixels: along the gradient for a dot, square to it for a corner
        normal = np.stack([-gy, gx] if dot else [gx, gy], 1)
        normals = np.einsum("n,ni,nj->ij", weight, normal, normal)
        values = np.linalg.eigvalsh(normals)
        if values[0] < 0.02 * values[1] or values[1] <= 0 or values.sum() < 40 * weight.sum():
            return None  # flat, or an edge: nothing that fixes both directions
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
