"""The ground of a cast: a disk with soft contact shadows, as the page shows it (`web/src/cast/shadow.ts`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter1d

from v3studio.pipelines.share.cast import GroundPlane
from v3studio.studio.cameras import Camera
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.similarity import Similarity

_SIDE = 64  # pixels of a shadow
_REACH = 0.06  # height at which a splat's share has fallen to 1/e, relative to the performer's
_BLUR = 5  # pixels over which a shadow is averaged, twice
_NEAR = 0.02  # highest place of a performer above the ground, relative to its height
_CLOSEST = 0.01  # depth, meters


@dataclass(frozen=True, eq=False)
class Shadow:
    """A performer's shadow, (64, 64) opacities from 0 to 1, rows along z, columns along x."""

    world: Similarity  # from the performer's coordinates, in which it stands on y = 0, to those of the ground
    corner: np.ndarray  # (2,) x and z of its first pixel's corner in the performer's coordinates
    pixel: float
    height: float
    opacities: np.ndarray

    @classmethod
    def of(cls, splats: Gaussians, box: np.ndarray, world: Similarity, strength: float) -> Shadow:
        """The shadow in a frame; `box`, (2, 3), bounds the whole take in the performer's coordinates; `strength` is the
        opacity of its darkest parts, 0 to 1."""
        low, high = box
        width, height = 1.3 * max(float((high - low)[[0, 2]].max()), 1e-6), max(float(high[1] - low[1]), 1e-6)
        corner, pixel = (low + high)[[0, 2]] / 2 - width / 2, width / _SIDE
        means = world.inverse.points(splats.means.cpu().numpy())
        scales = splats.scales.double().cpu().numpy() / world.scale
        columns, rows = np.floor((means[:, [0, 2]] - corner) / pixel).T
        inside = (columns >= 0) & (columns < _SIDE) & (rows >= 0) & (rows < _SIDE)
        area = np.pi * np.sort(scales, axis=1)[:, 1:].prod(axis=1) / pixel**2
        share = splats.opacities.double().cpu().numpy() * area * np.exp(-np.maximum(means[:, 1], 0) / (_REACH * height))
        places = (_SIDE * rows + columns)[inside].astype(int)
        cover = np.bincount(places, share[inside], _SIDE * _SIDE).reshape(_SIDE, _SIDE)
        for axis in (1, 0, 1, 0):
            cover = uniform_filter1d(cover, _BLUR, axis, mode="constant")
        return cls(world, corner, pixel, height, strength * (1 - np.exp(-cover)))

    def darken(self, light: np.ndarray, x: np.ndarray, z: np.ndarray) -> None:
        """Reduce the light (N,) at x and z (N,) of the ground."""
        inverse = self.world.inverse
        origin, (along_x, along_z) = inverse.translation, inverse.scale * inverse.rotation.T[[0, 2]]
        column, height, row = (origin[k] + along_x[k] * x + along_z[k] * z for k in range(3))
        column, row = (column - self.corner[0]) / self.pixel - 0.5, (row - self.corner[1]) / self.pixel - 0.5
        inside = (np.abs(column - _SIDE / 2) < _SIDE / 2) & (np.abs(row - _SIDE / 2) < _SIDE / 2)
        inside &= np.abs(height) < _NEAR * self.height
        light[inside] *= 1 - map_coordinates(self.opacities, [row[inside], column[inside]], order=1, mode="constant")


class Ground:
    """The ground in a frame."""

    def __init__(self, plane: GroundPlane, shadows: Sequence[Shadow]) -> None:
        self._plane, self._shadows = plane, shadows

    def seen(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """(H, W, 3) uint8 RGB and (H, W) float32 depth along the viewing axis, infinite beside the ground."""
        columns = ((np.arange(camera.width) + 0.5 - camera.cx) / camera.fx).astype(np.float32)
        rows = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy).astype(np.float32)[:, None]
        right, down, forward = camera.rotation.astype(np.float32)
        eye = camera.center.astype(np.float32)
        with np.errstate(divide="ignore"):
            depth = -eye[1] / (columns * right[1] + rows * down[1] + forward[1])
        depth[depth < _CLOSEST] = 0
        x, z = (eye[k] + depth * (columns * right[k] + rows * down[k] + forward[k]) for k in (0, 2))
        hit = (depth > 0) & (x * x + z * z < self._plane.radius**2)
        light = np.ones(int(hit.sum()), np.float32)
        for shadow in self._shadows:
            shadow.darken(light, x[hit], z[hit])
        pixels = np.zeros((*depth.shape, 3), np.uint8)
        pixels[hit] = (255 * light[:, None] * np.array(self._plane.color, np.float32) + 0.5).astype(np.uint8)
        return pixels, np.where(hit, depth, np.inf)
