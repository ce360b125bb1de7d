"""How far each camera's mask agrees with the volume on which the other cameras agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from studio.cameras import Rig
from studio.meshing.silhouettes import Silhouettes

_COARSE, _FINE = 48, 96
"""Voxels along each side while the volume is located, and for the comparison."""
_OUTVOTED = 0.15
"""Fraction of the cameras, besides one, that may reject a voxel of the common volume."""
_MISSING, _ABOVE_USUAL = 0.15, 0.12
"""A camera contradicts the others if more of its mask than this lies outside of their volume, or if its error is this
much above what is usual. Exact masks of a correct rig give 0.01 and 0.05 at most, the ragged masks of real footage 0.08
and 0.06; another camera's mask gives 0.14 to 0.96 and 0.2 or more."""
_USUAL = 2.5
"""The rig's median error is what is usual, but at most this divided by the number of cameras: the fewer they are, the
more a visual hull exceeds the performer, and the more unevenly. Correct rigs had 1.4 (16 cameras) and 1.9 (27)."""
LEAST_CAMERAS = 8
"""Fewer cannot outvote one: its wrong mask makes all contradict each other."""
PIXELS = 120_000
"""Pixels per mask that are enough here."""


@dataclass(frozen=True)
class MaskAgreement:
    """One camera's mask against the common volume of the other cameras.

    Attributes:
        missing: fraction of the mask that the volume does not reach, 0..1: none of a performer that all cameras see.
        extra: fraction of the volume's silhouette that is outside of the mask, 0..1. A volume of few cameras is larger
            than the performer, so correct rigs have some.
        box: left, top, right and bottom of the largest area that contradicts, in pixels of the view; None: no area
            does.
    """

    missing: float
    extra: float
    box: tuple[int, int, int, int] | None = None

    @property
    def error(self) -> float:
        """Both together."""
        return self.missing + self.extra


def mask_agreement(shapes: Silhouettes, min_views: int) -> dict[str, MaskAgreement]:
    """Compare each mask with the volume that most of the other cameras see as foreground.

    Differences of two voxels, a 48th of the volume's size, are tolerated.

    Args:
        shapes: silhouettes, of at least `LEAST_CAMERAS` cameras.
        min_views: number of cameras that must see a point of the volume.

    Returns:
        By camera; empty if they have no common volume.
    """
    least = max(2, min_views - 1)  # without one of them
    rig = Rig(tuple(shapes.cameras))
    middle = rig.focus
    half = 0.6 * float(np.linalg.norm(rig.centers - middle, axis=1).mean())
    for count in (_COARSE, _COARSE, _FINE):
        voxel = 2 * half / (count - 1)
        axis = torch.linspace(-half, half, count)
        points = torch.cartesian_prod(axis, axis, axis) + torch.from_numpy(middle.astype(np.float32))
        slack = (0.5 if count == _FINE else 0.87) * voxel  # 0.87: half of a voxel's diagonal
        inside, seen = _votes(shapes, points, slack)
        accepting, views = inside.sum(0), seen.sum(0)
        agreed = points[_agreed(accepting, views, least)]
        if not len(agreed):
            return {}
        low, high = agreed.amin(0), agreed.amax(0)
        middle, half = ((low + high) / 2).numpy(), float((high - low).max() / 2) + 2 * voxel
    return {
        name: _compare(
            shapes, index, points[_agreed(accepting - inside[index].int(), views - seen[index].int(), least)], voxel
        )
        for index, name in enumerate(shapes.names)
    }


def contradicting(agreement: dict[str, MaskAgreement]) -> list[str]:
    """Cameras whose mask contradicts the others, the worst first."""
    if not agreement:
        return []
    usual = min(float(np.median([each.error for each in agreement.values()])), _USUAL / len(agreement))
    most = usual + max(_ABOVE_USUAL, 1 / len(agreement))
    worst = sorted(agreement, key=lambda name: -agreement[name].error)
    return [name for name in worst if agreement[name].missing > _MISSING or agreement[name].error > most]


def _votes(shapes: Silhouettes, points: torch.Tensor, slack: float) -> tuple[torch.Tensor, torch.Tensor]:
    """(cameras, N) bool: whether each camera's mask holds a point, give or take `slack`, and whether it sees it."""
    inside, seen = [], []
    for index in range(len(shapes)):
        distance, visible = shapes.distance(index, points)
        inside.append(visible & (distance > -slack))
        seen.append(visible)
    return torch.stack(inside), torch.stack(seen)


def _agreed(accepting: torch.Tensor, views: torch.Tensor, least: int) -> torch.Tensor:
    return (views >= least) & (accepting >= (1 - _OUTVOTED) * views)


def _compare(shapes: Silhouettes, index: int, volume: torch.Tensor, voxel: float) -> MaskAgreement:
    import cv2

    camera, mask = shapes.cameras[index], (shapes.masks[index] >= 128).astype(np.uint8)
    pixels, depth = shapes.project(index, volume)
    column, row = pixels.floor().long().T
    shown = (depth > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    cover = np.zeros(mask.shape, np.uint8)
    cover[row[shown], column[shown]] = 1
    near = float(depth[shown].median()) if bool(shown.any()) else np.inf
    radius = int(np.ceil(0.6 * voxel * camera.fx / near))  # closes the gaps between the voxels' centers
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    cover = np.asarray(cv2.morphologyEx(cover, cv2.MORPH_CLOSE, disk), np.uint8)
    missing = (mask > 0) & (cv2.dilate(cover, disk) == 0)
    extra = (cover > 0) & (cv2.dilate(mask, disk) == 0)
    return MaskAgreement(
        int(missing.sum()) / max(int(mask.sum()), 1),
        int(extra.sum()) / max(int(cover.sum()), 1),
        _largest_box(missing | extra, shapes.footprints[index] / max(camera.fx, camera.fy)),
    )


def _largest_box(area: np.ndarray, enlarged: float) -> tuple[int, int, int, int] | None:
    """The box of the largest connected part of an area (H, W) bool, in pixels of an image enlarged by that factor."""
    import cv2

    count, _, stats, _ = cv2.connectedComponentsWithStats(area.astype(np.uint8), connectivity=8)
    if count == 1:
        return None
    left, top, width, height, _ = stats[1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())]
    left, top, right, bottom = (round(enlarged * float(one)) for one in (left, top, left + width, top + height))
    return left, top, right, bottom
