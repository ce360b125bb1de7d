"""Where a solution lies in the world: similarity transforms, alignment to a reference, comparison with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from studio.cameras import Rig
from studio.errors import StudioError


@dataclass(frozen=True)
class Similarity:
    """x' = scale * rotation @ x + translation.

    Attributes:
        scale: positive.
        rotation: (3, 3).
        translation: (3,).
    """

    scale: float
    rotation: np.ndarray
    translation: np.ndarray

    def points(self, points: np.ndarray) -> np.ndarray:
        """Transformed points (N, 3)."""
        return self.scale * points @ self.rotation.T + self.translation

    def rig(self, rig: Rig) -> Rig:
        """The same cameras in the new world: every image stays the same."""
        cameras = []
        for camera in rig:
            pose = np.eye(4)
            pose[:3, :3] = camera.rotation @ self.rotation.T
            pose[:3, 3] = -pose[:3, :3] @ self.points(camera.center[None])[0]
            cameras.append(replace(camera, world_to_camera=pose))
        return Rig(tuple(cameras))


def align_points(source: np.ndarray, target: np.ndarray) -> Similarity:
    """The similarity that brings source (N, 3) nearest to target (N, 3) in least squares (Umeyama 1991).

    Raises:
        StudioError: fewer than three points, or all on one spot.
    """
    if len(source) < 3:
        raise StudioError(f"At least 3 common cameras are needed to align two solutions, found {len(source)}.")
    middle_source, middle_target = source.mean(0), target.mean(0)
    a, b = source - middle_source, target - middle_target
    spread = (a * a).sum() / len(a)
    if spread < 1e-18:
        raise StudioError("The cameras all stand on one spot: two solutions cannot be aligned by them.")
    u, d, vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.ones(3)
    sign[2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = u @ np.diag(sign) @ vt
    scale = float((d * sign).sum() / spread)
    return Similarity(scale, rotation, middle_target - scale * rotation @ middle_source)


def align_rigs(source: Rig, target: Rig) -> Similarity:
    """The similarity from one solution to another, by the centers of the cameras they share.

    Raises:
        StudioError: fewer than three common cameras, or all on one spot.
    """
    names = [name for name in source.names if name in target]
    return align_points(source.subset(names).centers, target.subset(names).centers)


def upright(rig: Rig, points: np.ndarray, *, keep_scale: bool = False) -> Similarity:
    """The world that a rig alone suggests.

    z up is the mean of the cameras' up directions, the origin is the point that the cameras look at (the middle of the
    points where the axes do not meet before the cameras), x points from there toward the first camera, and the mean
    distance of the cameras from the origin is 1.

    Args:
        rig: the cameras.
        points: (P, 3) sparse points.
        keep_scale: leave the scale as it is (meters, say).
    """
    centers = rig.centers
    focus = rig.focus
    before = [float((focus - camera.center) @ camera.forward) > 0 for camera in rig]
    if np.mean(before) < 0.9 and len(points):
        focus = np.median(points, axis=0)
    up = -np.mean([camera.rotation[1] for camera in rig], axis=0)
    if np.linalg.norm(up) < 0.1:  # cameras on all sides of a sphere have no common up
        up = np.array([0.0, 0.0, 1.0])
    up /= np.linalg.norm(up)
    toward = centers[0] - focus
    toward = toward - (toward @ up) * up
    if np.linalg.norm(toward) < 1e-9:
        toward = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    x = toward / np.linalg.norm(toward)
    rotation = np.stack([x, np.cross(up, x), up])
    distance = float(np.linalg.norm(centers - focus, axis=1).mean())
    scale = 1.0 if keep_scale else 1.0 / max(distance, 1e-12)
    return Similarity(scale, rotation, -scale * rotation @ focus)


def floor_world(rig: Rig, points: np.ndarray, *, seed: int = 0) -> tuple[Similarity, dict[str, float]]:
    """The world in which the floor is level and at height 0; directions and scale stay as they are otherwise.

    The floor is the plane with the most sparse points of those nearly square to the cameras' common up that have nine
    tenths of all points above or on them and the cameras above (RANSAC).

    Args:
        rig: the cameras; up is about z (as after `upright`).
        points: (P, 3) sparse points.
        seed: of the random choice.

    Returns:
        the transform, and `tilt` (degrees that up changes), `height` (by which the origin rises), `share` of the points
        on the floor.

    Raises:
        StudioError: no plane holds a twentieth of the points.
    """
    if len(points) < 50:
        raise StudioError(f"The floor cannot be found among {len(points)} sparse points; switch calibrate.floor off.")
    rng = np.random.default_rng(seed)
    size = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    within, up = 0.01 * size, rig.up
    best, found = 0, None
    for _ in range(2000):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12 * size**2:
            continue
        normal = normal / length if normal @ up > 0 else -normal / length
        if normal @ up < np.cos(np.radians(25)):
            continue
        heights = (points - a) @ normal
        count = int((np.abs(heights) < within).sum())
        if count > best and (heights > -3 * within).mean() > 0.9 and ((rig.centers - a) @ normal > 0).all():
            best, found = count, (normal, a)
    if found is None or best < 0.05 * len(points):
        raise StudioError(
            "No floor was found: no level plane below the cameras holds a twentieth of the sparse points; switch "
            "calibrate.floor off, or give the floor some texture."
        )
    on = points[np.abs((points - found[1]) @ found[0]) < within]
    middle = on.mean(0)
    normal = np.linalg.svd(on - middle, full_matrices=False)[2][2]
    normal = normal if normal @ up > 0 else -normal
    z = np.array([0.0, 0.0, 1.0])
    axis = np.cross(normal, z)
    angle = float(np.arctan2(np.linalg.norm(axis), normal @ z))
    rotation = _about(axis, angle)
    height = float((rotation @ middle)[2])
    figures = {
        "tilt": round(float(np.degrees(angle)), 3),
        "height": round(height, 6),
        "share": round(best / len(points), 3),
    }
    return Similarity(1.0, rotation, np.array([0.0, 0.0, -height])), figures


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation about an axis of any length (Rodrigues)."""
    length = np.linalg.norm(axis)
    if length < 1e-12:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def scale_to_distance(rig: Rig, first: str, second: str, distance: float) -> Similarity:
    """Scaling about the origin that puts two cameras at a known distance.

    Raises:
        StudioError: an unknown camera, a distance that is not positive, cameras on one spot.
    """
    if not distance > 0:
        raise StudioError(f"The known distance between '{first}' and '{second}' is {distance}; it must be positive.")
    found = float(np.linalg.norm(rig[first].center - rig[second].center))
    if found < 1e-12:
        raise StudioError(f"'{first}' and '{second}' stand on one spot; name two cameras that are apart.")
    return Similarity(distance / found, np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class RigDifference:
    """How far a solution is from a reference after alignment.

    Attributes:
        centers: a camera each, distance of the centers in the reference's units.
        rotations: a camera each, degrees.
        radius: mean distance of the reference's cameras from their middle, to put the centers in relation to.
    """

    centers: dict[str, float]
    rotations: dict[str, float]
    radius: float

    @property
    def center_percent(self) -> float:
        """Largest distance of a center, percent of the rig's radius."""
        return 100.0 * max(self.centers.values()) / self.radius

    @property
    def rotation_degrees(self) -> float:
        """Largest rotation."""
        return max(self.rotations.values())


def compare_rigs(found: Rig, reference: Rig) -> RigDifference:
    """Align a solution with a reference and measure what differs, over the cameras they share.

    Raises:
        StudioError: fewer than three common cameras.
    """
    aligned = align_rigs(found, reference).rig(found)
    names = [name for name in found.names if name in reference]
    centers, rotations = {}, {}
    for name in names:
        a, b = aligned[name], reference[name]
        centers[name] = float(np.linalg.norm(a.center - b.center))
        # By the sine of half the angle: exact for small rotations too.
        rotations[name] = float(
            np.degrees(2 * np.arcsin(min(1.0, float(np.linalg.norm(a.rotation - b.rotation)) / 8**0.5)))
        )
    middle = reference.subset(names).centers
    radius = float(np.linalg.norm(middle - middle.mean(0), axis=1).mean())
    return RigDifference(centers, rotations, radius)
