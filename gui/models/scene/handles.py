"""Handles of the crop box and the ground plane, and points under the pointer."""

from dataclasses import dataclass

import numpy as np

from v3studio.studio.cameras import Camera
from v3studio.studio.edits.edit_list import CropBox, EditList, Ground
from v3studio.studio.rotations import matrices_to_quats

REACH = 16.0  # pixels from a handle within which it is grabbed
PICK_RADII = (6.0, 20.0)  # pixels around a click in which splats are looked for, the first that has some

LEAST_SLANT = 0.25
"""Sine of the angle between a handle's direction and the line of sight below which it cannot be dragged well."""

MARGIN = 1.15  # size of a new crop box, relative to the performer's
_THINNEST = 0.01  # least length of an edge, relative to the longest one


@dataclass(frozen=True, eq=False)
class Handle:
    """A point, "crop 0 -1" (axis, side) or "ground", that can be dragged along a direction; (3,) world."""

    name: str
    place: np.ndarray
    direction: np.ndarray

    def distance(self, view: Camera, start: tuple[float, float], end: tuple[float, float]) -> float:
        """Return how far the handle is moved along its direction by a drag in pixels, world units."""
        along, step = self._along(view)
        length = float(along @ along)
        return float(np.subtract(end, start) @ along) / length * step if length > 1e-6 else 0.0

    def movable(self, view: Camera) -> bool:
        """Whether it can be dragged in a view: it is not seen almost along its direction."""
        return float(np.linalg.norm(self._along(view)[0])) > LEAST_SLANT

    def _along(self, view: Camera) -> tuple[np.ndarray, float]:
        """(2,) pixels by which it moves for a step of about a pixel, and the step, world units."""
        _, depth = view.project(self.place[None])
        step = max(float(depth[0]), 1e-6) / view.fx
        ends, _ = view.project(np.stack([self.place, self.place + step * self.direction]))
        return ends[1] - ends[0], step


def crop_handles(box: CropBox) -> list[Handle]:
    """The middles of the faces of a box."""
    center, axes = np.array(box.center), box.axes
    return [
        Handle(f"crop {axis} {side}", center + 0.5 * side * box.size[axis] * axes[axis], side * axes[axis])
        for axis in range(3)
        for side in (-1, 1)
    ]


def ground_handle(ground: Ground, around: np.ndarray) -> Handle:
    """The point of the plane below or above a point (3,)."""
    return Handle("ground", around + (ground.height - around @ ground.unit) * ground.unit, ground.unit)


def grabbed(handles: list[Handle], view: Camera, x: float, y: float) -> Handle | None:
    """The handle at a pixel, the nearest one to the viewer; None if there is none."""
    if not handles:
        return None
    pixels, depth = view.project(np.stack([handle.place for handle in handles]))
    near = np.flatnonzero((depth > 0) & (np.linalg.norm(pixels - (x, y), axis=1) <= REACH))
    return handles[near[depth[near].argmin()]] if len(near) else None


def moved_crop(box: CropBox, handle: Handle, distance: float) -> CropBox:
    """The box with the face of a handle moved outwards."""
    _, axis_name, _ = handle.name.split()
    axis, size = int(axis_name), list(box.size)
    length = max(size[axis] + distance, _THINNEST * max(size))
    center = np.array(box.center) + 0.5 * (length - size[axis]) * handle.direction
    size[axis] = length
    return box.model_copy(update={"center": tuple(center.tolist()), "size": tuple(size)})


def default_crop(points: np.ndarray, edits: EditList, up: np.ndarray) -> CropBox:
    """A box around points (N, 3), with an edge along up; axes of the placed world if its up is set."""
    axes = _axes(edits, up)
    local = points @ axes.T
    low, high = np.quantile(local, (0.002, 0.998), axis=0)
    size = np.maximum((high - low) * MARGIN, 1e-6)
    center = (low + high) / 2 @ axes
    box = {"center": center.tolist(), "size": size.tolist(), "rotation": matrices_to_quats(axes.T).tolist()}
    return CropBox.model_validate(box)


def default_ground(points: np.ndarray, up: np.ndarray) -> Ground:
    """The plane under points (N, 3), without the few lowest."""
    heights = points @ up
    return Ground(normal=tuple(up.tolist()), height=float(np.quantile(heights, 0.002)))


def _axes(edits: EditList, up: np.ndarray) -> np.ndarray:
    """(3, 3) unit vectors, one per row, the second one up."""
    if edits.world is not None and edits.world.up is not None:
        return edits.similarity.rotation
    across = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across /= np.linalg.norm(across)
    return np.stack([across, up, np.cross(across, up)])


def up_of(edits: EditList, captured: np.ndarray) -> np.ndarray:
    """(3,) unit vector: up in the world of the capture, as set or else as captured."""
    up = captured if edits.world is None or edits.world.up is None else np.array(edits.world.up)
    unit: np.ndarray = np.asarray(up, np.float64) / max(float(np.linalg.norm(up)), 1e-12)
    return unit


def picked(view: Camera, means: np.ndarray, x: float, y: float) -> np.ndarray | None:
    """(3,) the point under a pixel: on the nearest of the splats (N, 3) that are seen there; None if there are none."""
    if not len(means):
        return None
    pixels, depth = view.project(means)
    apart = np.where(depth > 0, np.linalg.norm(pixels - (x, y), axis=1), np.inf)
    for radius in PICK_RADII:
        near = np.sort(depth[apart <= radius])
        if len(near):
            # not the very first: a stray splat may hover in front
            point: np.ndarray = view.unproject(np.array([[x, y]]), float(near[min(3, len(near) - 1)]))[0]
            return point
    return None
