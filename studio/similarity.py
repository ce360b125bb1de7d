"""Similarity transforms between two worlds: rotation, scale and translation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.counts import short_repr
from v3studio.studio.json_types import JsonObject
from v3studio.studio.rotations import matrices_to_quats, quats_to_matrices


@dataclass(frozen=True, eq=False)
class Similarity:
    """new = scale * rotation @ old + translation."""

    scale: float = 1.0  # units of the new world in one of the old world, above 0
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))  # (3, 3) float64, orthonormal, determinant 1
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))  # (3,) float64, units of the new world

    __repr__ = short_repr

    @property
    def is_identity(self) -> bool:
        return self.scale == 1 and not self.translation.any() and np.array_equal(self.rotation, np.eye(3))

    @property
    def inverse(self) -> Similarity:
        back = self.rotation.T
        return Similarity(1 / self.scale, back, -back @ self.translation / self.scale)

    def after(self, first: Similarity) -> Similarity:
        """The transform that applies `first`, then this one."""
        if first.is_identity or self.is_identity:
            return self if first.is_identity else first
        return Similarity(self.scale * first.scale, self.rotation @ first.rotation, self.points(first.translation))

    def points(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the old world in the new one, float64."""
        moved: np.ndarray = self.scale * (np.asarray(points, np.float64) @ self.rotation.T) + self.translation
        return moved

    def directions(self, directions: np.ndarray) -> np.ndarray:
        """(..., 3) directions of the old world in the new one, of the same lengths, float64."""
        turned: np.ndarray = np.asarray(directions, np.float64) @ self.rotation.T
        return turned

    def camera(self, camera: Camera) -> Camera:
        """The camera that sees of the new world what `camera` sees of the old one; depths are `scale` times as far."""
        pose = np.eye(4)
        pose[:3, :3] = camera.rotation @ self.rotation.T
        pose[:3, 3] = self.scale * camera.translation - pose[:3, :3] @ self.translation
        return replace(camera, world_to_camera=pose)

    def rig(self, rig: Rig) -> Rig:
        """The cameras that see of the new world what those of a rig see of the old one."""
        return replace(rig, cameras=tuple(self.camera(camera) for camera in rig))

    def to_json(self) -> JsonObject:
        """Scale, rotation (quaternion wxyz) and translation, read back by `from_json`."""
        return {
            "scale": float(self.scale),
            "rotation": [float(value) for value in matrices_to_quats(self.rotation)],
            "translation": [float(value) for value in self.translation],
        }

    @classmethod
    def from_json(cls, values: Any) -> Similarity | None:
        """Read `to_json`; None if it is malformed."""
        try:
            scale = float(values["scale"])
            quat = np.array(values["rotation"], np.float64)
            translation = np.array(values["translation"], np.float64)
            if quat.shape != (4,) or translation.shape != (3,) or not np.isfinite(translation).all():
                return None
            if not (0 < scale < np.inf and 0.5 < np.linalg.norm(quat) < 2):
                return None
            return cls(scale, quats_to_matrices(quat), translation)
        except (TypeError, ValueError, KeyError, OverflowError):
            return None


def rotation_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(3, 3): the shortest rotation of a direction, (3,) of any length, onto another; if opposite, about any axis."""
    start, end = (np.asarray(value, np.float64) / np.linalg.norm(value) for value in (start, end))
    cosine = float(start @ end)
    if cosine < -1 + 1e-12:
        axis = np.cross(start, np.eye(3)[np.abs(start).argmin()])
        axis /= np.linalg.norm(axis)
        return 2 * np.outer(axis, axis) - np.eye(3)
    x, y, z = np.cross(start, end)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: np.ndarray = np.eye(3) + across + across @ across / (1 + cosine)
    return rotation
