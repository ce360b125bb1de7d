"""World coordinates of a solution: similarity transforms, alignment with a reference and comparison."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from v3studio.studio.calibration.report import FloorReport
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError
from v3studio.studio.similarity import Similarity


def align_points(source: np.ndarray, target: np.ndarray) -> Similarity:
    """The least-squares similarity from source (N, 3) to target (N, 3) (Umeyama 1991). StudioError if there are fewer
    than 3 points (calibration.too_few_points), or all coincide (calibration.coincident)."""
    if len(source) < 3:
        problem = f"two solutions need at least 3 common cameras or points to be aligned, found {len(source)}"
        raise StudioError("calibration.too_few_points", problem, value=len(source), expected=3)
    middle_source, middle_target = source.mean(0), target.mean(0)
    a, b = source - middle_source, target - middle_target
    spread = (a * a).sum() / len(a)
    if spread < 1e-18:
        problem = "two solutions cannot be aligned: their common cameras or points coincide"
        raise StudioError("calibration.coincident", problem)
    u, d, vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.ones(3)
    sign[2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = u @ np.diag(sign) @ vt
    scale = float((d * sign).sum() / spread)
    return Similarity(scale, rotation, middle_target - scale * rotation @ middle_source)


def align_rigs(source: Rig, target: Rig) -> Similarity:
    """The similarity from one solution to another by their common cameras' centers; StudioError as `align_points`."""
    names = [name for name in source.names if name in target]
    return align_points(source.subset(names).centers, target.subset(names).centers)


def upright(rig: Rig, points: np.ndarray, *, keep_scale: bool = False) -> Similarity:
    """The transform to world coordinates that are defined by the cameras alone.

    z is the mean of the cameras' up directions, the origin is the point that the cameras look at (the median of the (P,
    3) points if the viewing axes do not meet in front of the cameras), x points from there toward the first camera, and
    the mean distance of the cameras from the origin is 1.
    """
    centers = rig.centers
    focus = rig.focus
    before = [float((focus - camera.center) @ camera.forward) > 0 for camera in rig]
    if np.mean(before) < 0.9 and len(points):
        focus = np.median(points, axis=0)
    up = -np.mean([camera.rotation[1] for camera in rig], axis=0)
    if np.linalg.norm(up) < 0.1:  # cameras all around a sphere have no common up direction
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


def floor_world(rig: Rig, points: np.ndarray) -> tuple[Similarity, FloorReport]:
    """The transform to world coordinates in which the floor is level and at height 0, with a report of the floor plane;
    scale and heading do not change.

    The floor is the plane with the most of the (P, 3) sparse points (RANSAC) among all planes within 25 degrees of
    horizontal that have 90% of the points on or above them and all cameras above them. The rig has z approximately up,
    as after `upright`. StudioError (calibration.no_floor) with fewer than 50 points, or if no such plane has 5% of
    them.
    """
    if len(points) < 50:
        problem = f"{len(points)} sparse points are too few to find the floor, expected at least 50"
        fix = "Set calibrate.floor to false."
        raise StudioError(
            "calibration.no_floor", problem, value=len(points), fix=fix, setting="calibrate.floor", expected=50
        )
    rng = np.random.default_rng(0)
    size = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    within, up = 0.01 * size, rig.up
    best, floor = 0, None
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
            best, floor = count, (normal, a)
    if floor is None or best < 0.05 * len(points):
        problem = "no floor found: no level plane below the cameras has 5% of the sparse points"
        value = round(best / len(points), 3)
        fix = "Set calibrate.floor to false, or put textured mats on the floor."
        raise StudioError(
            "calibration.no_floor", problem, value=value, fix=fix, setting="calibrate.floor", expected=0.05
        )
    on = points[np.abs((points - floor[1]) @ floor[0]) < within]
    middle = on.mean(0)
    normal = np.linalg.svd(on - middle, full_matrices=False)[2][2]
    normal = normal if normal @ up > 0 else -normal
    turn = Rotation.align_vectors([[0, 0, 1]], [normal])[0]
    height, tilt = float(turn.apply(middle)[2]), float(np.degrees(turn.magnitude()))
    figures = FloorReport(tilt=round(tilt, 3), share=round(best / len(points), 3))
    return Similarity(1.0, turn.as_matrix(), np.array([0.0, 0.0, -height])), figures


def scale_to_distance(rig: Rig, first: str, second: str, distance: float) -> Similarity:
    """The scaling about the origin after which two cameras are `distance` apart. Raises StudioError."""
    unscaled = float(np.linalg.norm(rig[first].center - rig[second].center))
    if unscaled < 1e-12:
        problem = f"cameras '{first}' and '{second}' are at the same position"
        fix = "Choose two cameras that are apart."
        raise StudioError(
            "calibration.coincident", problem, value=[first, second], fix=fix, setting="calibrate.known_distance"
        )
    return Similarity(distance / unscaled)


@dataclass(frozen=True)
class RigDifference:
    """Differences of cameras between a solution and a reference after alignment: distances of centers in units of the
    reference, angles in degrees, and the mean distance of the reference's camera centers from their mean."""

    centers: dict[str, float]
    rotations: dict[str, float]
    radius: float

    @property
    def center_percent(self) -> float:
        """Largest center distance as a percentage of the radius."""
        return 100.0 * max(self.centers.values()) / self.radius

    @property
    def rotation_degrees(self) -> float:
        """Largest angle in degrees."""
        return max(self.rotations.values())


def compare_rigs(rig: Rig, reference: Rig) -> RigDifference:
    """Align a solution with a reference and compare their common cameras; StudioError as `align_points`."""
    aligned = align_rigs(rig, reference).rig(rig)
    names = [name for name in rig.names if name in reference]
    centers, rotations = {}, {}
    for name in names:
        a, b = aligned[name], reference[name]
        centers[name] = float(np.linalg.norm(a.center - b.center))
        rotations[name] = float(np.degrees(Rotation.from_matrix(a.rotation @ b.rotation.T).magnitude()))
    middle = reference.subset(names).centers
    radius = float(np.linalg.norm(middle - middle.mean(0), axis=1).mean())
    return RigDifference(centers, rotations, radius)
