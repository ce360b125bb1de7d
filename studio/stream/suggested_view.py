"""A first view for a stream: from a camera's place, upright, with the scene in the middle and as large as fits."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from v3studio.studio.cameras import Camera, look_at_pose
from v3studio.studio.gaussians import Gaussians

MARGIN = 1.08  # how much larger than the scene's box the image is

_EDGES = np.array([place for place in product((-1, 0, 1), repeat=3) if place.count(0) == 1])
"""(12, 3) middles of the edges of a cube from -1 to 1."""

EYE_LEVEL = np.radians(10.0)  # radians above the horizon at which players begin at most (docs/WEB.md)

_NARROWEST = 0.02  # tangent of half the field of view, where the box is a point

_SEEN = 0.05  # opacity of splats that count
_STRAY = 0.001  # share of splats that may lie outside, on each side of each axis


def seen_box(frames: Iterable[Gaussians]) -> tuple[np.ndarray, np.ndarray] | None:
    """The (3,) least and greatest corner, world units, float64, of the visible splats in frames of a group: without
    faint splats, and without the few that lie far from all others; None if nothing can be seen."""
    visible = [frame.means[frame.opacities.reshape(-1) >= _SEEN].detach().cpu().numpy() for frame in frames]
    corners = [np.quantile(means.astype(np.float64), (_STRAY, 1 - _STRAY), axis=0) for means in visible if len(means)]
    if not corners:
        return None
    return np.min([low for low, _ in corners], axis=0), np.max([high for _, high in corners], axis=0)


def suggested_view(camera: Camera, low: Sequence[float], high: Sequence[float], up: np.ndarray) -> Camera:
    """The camera's place and image size, without lens distortion; it looks at the middle of a box, which fills the
    image.

    The middles of the box's edges are inside the image. Its corners, where hardly anything ever is, need not be.
    `camera` without its distortion if it is inside the box or above or below its middle: there is no upright view that
    shows the box.
    """
    middle = (np.array(low) + np.array(high)) / 2
    edges = middle + _EDGES * (np.array(high) - np.array(low)) / 2
    towards = middle - camera.center
    upright = up / np.linalg.norm(up)
    if np.linalg.norm(np.cross(towards, upright)) < 0.05 * np.linalg.norm(towards):
        return camera.undistorted()
    pose = look_at_pose(camera.center, middle, upright)
    x, y, z = pose[:3, :3] @ edges.T + pose[:3, 3:]
    if z.min() <= 0:
        return camera.undistorted()
    across, along = (MARGIN * max(float(np.abs(values / z).max()), _NARROWEST) for values in (x, y))
    focal = min(camera.width / 2 / across, camera.height / 2 / along)
    K = np.array([[focal, 0, camera.width / 2], [0, focal, camera.height / 2], [0, 0, 1.0]])
    return Camera(camera.name, camera.width, camera.height, K, pose)


def eye_level_view(view: Camera, low: Sequence[float], high: Sequence[float], up: np.ndarray) -> Camera:
    """The first view of the browser player: a suggested view, lowered or raised to eye level around the middle of the
    whole stream's box; `view` itself if it is at eye level, or looks straight up or down."""
    upright = up / np.linalg.norm(up)
    forward = view.rotation[2]
    elevation = float(np.arcsin(np.clip(-forward @ upright, -1, 1)))
    flat = forward - (forward @ upright) * upright
    if abs(elevation) <= EYE_LEVEL or np.linalg.norm(flat) < 0.05:
        return view
    middle = (np.array(low) + np.array(high)) / 2
    level = np.sign(elevation) * EYE_LEVEL
    towards = np.cos(level) * flat / np.linalg.norm(flat) - np.sin(level) * upright
    eye = middle - np.linalg.norm(middle - view.center) * towards
    return suggested_view(replace(view, world_to_camera=look_at_pose(eye, middle, upright)), low, high, upright)
