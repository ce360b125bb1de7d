"""Measures how far each camera's mask agrees with the volume on which the other cameras agree."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch

from v3studio.studio.cameras import Rig
from v3studio.studio.meshing.silhouettes import Silhouette, votes

_COARSE, _FINE = 48, 96  # voxels along each side while the volume is located, and for the comparison
_OUTVOTED = 0.15  # fraction of the cameras, besides one, that may reject a voxel of the common volume
_REACH = 0.6  # voxels from a center that belong to it, and that are tolerated at an outline
_MISSING, _MISSING_MORE = 0.15, 5
"""A camera contradicts the others if more of its mask than this lies outside of their volume, or this many times as
much as in three quarters of the cameras."""
_LEAST_MISSING = 0.015
"""It does not if less of it does. In correct rigs, at most 0.0005 of masks from clean plates and 0.02 of ragged masks
lie outside, in three quarters of the cameras 0.006; of a mask that is five frames late, 0.016 to 0.23."""
_ABOVE_USUAL = 0.12
"""A camera also contradicts the others if its error is this much above what is usual: at most 0.1 in correct rigs."""
_USUAL = 2.5
"""The rig's median error is what is usual, but at most this divided by the number of cameras: the fewer they are, the
more a visual hull exceeds the performer, and the more unevenly. Correct rigs had 1.4 (16 cameras) and 1.9 (27)."""
LEAST_CAMERAS = 8  # fewer cannot outvote one: its wrong mask makes all contradict each other
PIXELS = 120_000  # pixels per mask that are enough here


@dataclass(frozen=True)
class MaskVerdict:
    """A camera's mask in a frame, against the common volume of the other cameras.

    Attributes:
        camera, frame: the name, and the number in the footage.
        lacks: fraction of the volume's silhouette that is outside of the mask, 0 to 1. A volume of few cameras is
            larger than the performer, so correct rigs have some.
        more: fraction of the mask that the volume does not reach, 0 to 1: none of a performer that all cameras see.
        wrong: whether it contradicts the others.
        box: left, top, right and bottom of the largest area that contradicts, in pixels of the view; None: none does.
    """

    camera: str
    frame: int
    lacks: float
    more: float
    wrong: bool = False
    box: tuple[int, int, int, int] | None = None

    @property
    def error(self) -> float:
        """The sum of both."""
        return self.lacks + self.more

    @property
    def words(self) -> str:
        """The larger fault."""
        if self.lacks >= self.more:
            return f"{self.lacks:.0%} of the performer is missing"
        return f"{self.more:.0%} of it is no performer"


def mask_verdicts(shapes: list[Silhouette], min_views: int, frame: int = 0) -> tuple[MaskVerdict, ...]:
    """Compare each mask, of at least `LEAST_CAMERAS`, with the volume that most of the other cameras see as foreground:
    the worst first; empty if they have none in common. Differences of two voxels, a 48th of the volume's size, are
    tolerated. `min_views`: cameras that must see a place (`least_views`)."""
    least = max(2, min_views - 1)  # without one of them
    common = _common_volume(shapes, least)
    if common is None:
        return ()
    verdicts = [
        _compare(shape, shape.mask, common.without(index, least), common.voxel, frame)
        for index, shape in enumerate(shapes)
    ]
    more, errors = [verdict.more for verdict in verdicts], [verdict.error for verdict in verdicts]
    outside = min(_MISSING, max(_LEAST_MISSING, _MISSING_MORE * float(np.quantile(more, 0.75))))
    most = min(float(np.median(errors)), _USUAL / len(verdicts)) + max(_ABOVE_USUAL, 1 / len(verdicts))
    judged = (replace(verdict, wrong=verdict.more > outside or verdict.error > most) for verdict in verdicts)
    return tuple(sorted(judged, key=lambda verdict: (not verdict.wrong, -verdict.error)))


def least_views(shapes: list[Silhouette]) -> int:
    """Return the number of cameras that must see a place."""
    return max(3, len(shapes) // 3)


def frame_that_fits(shapes: list[Silhouette], name: str, masks: Mapping[int, np.ndarray], min_views: int) -> int | None:
    """The frame whose mask of a camera, (H, W) uint8 of full or reduced size, fits the volume of the other cameras,
    though that in `shapes` does not; None if none contradicts them a third as much."""
    index = next(index for index, shape in enumerate(shapes) if shape.camera.name == name)
    shape, least = shapes[index], max(2, min_views - 1)
    common = _common_volume(shapes, least)
    if common is None or not masks:
        return None
    size = shape.camera.width, shape.camera.height
    volume = common.without(index, least)
    reduced = {frame: cv2.resize(mask, size, interpolation=cv2.INTER_AREA) for frame, mask in masks.items()}
    errors = {frame: _compare(shape, mask, volume, common.voxel) for frame, mask in reduced.items()}
    now = _compare(shape, shape.mask, volume, common.voxel)
    best = min(errors, key=lambda frame: errors[frame].error)
    return best if errors[best].more < now.more / 3 and errors[best].error < now.error else None


def common_points(shapes: list[Silhouette], min_views: int) -> np.ndarray | None:
    """(N, 3) points in the volume on which the cameras agree, some 40 along its longest side; None: there is none."""
    common = _common_volume(shapes, min_views, (_COARSE, _COARSE))
    if common is None:
        return None
    return common.points[_agreed(common.accepting, common.views, min_views)].numpy()


@dataclass(frozen=True)
class _Common:
    """Points (N, 3), `voxel` apart, in and around the volume on which the cameras agree; see `votes`."""

    points: torch.Tensor
    inside: torch.Tensor
    seen: torch.Tensor
    accepting: torch.Tensor
    views: torch.Tensor
    voxel: float

    def without(self, index: int, least: int) -> torch.Tensor:
        """The points on which the cameras agree besides one."""
        accepting = self.accepting - self.inside[index].int()
        return self.points[_agreed(accepting, self.views - self.seen[index].int(), least)]


def _common_volume(
    shapes: list[Silhouette], least: int, sides: tuple[int, ...] = (_COARSE, _COARSE, _FINE)
) -> _Common | None:
    """Coarse to fine; None: there is none."""
    rig = Rig(tuple(shape.camera for shape in shapes))
    middle = rig.focus
    half = 0.6 * float(np.linalg.norm(rig.centers - middle, axis=1).mean())
    for count in sides:
        voxel = 2 * half / (count - 1)
        axis = torch.linspace(-half, half, count)
        points = torch.cartesian_prod(axis, axis, axis) + torch.from_numpy(middle.astype(np.float32))
        slack = (0.5 if count == _FINE else 0.87) * voxel  # 0.87: half of a voxel's diagonal
        inside, seen = votes(shapes, points, slack)
        accepting, views = inside.sum(0, dtype=torch.int32), seen.sum(0, dtype=torch.int32)
        agreed = points[_agreed(accepting, views, least)]
        if not len(agreed):
            return None
        low, high = agreed.amin(0), agreed.amax(0)
        middle, half = ((low + high) / 2).numpy(), float((high - low).max() / 2) + 2 * voxel
    return _Common(points, inside, seen, accepting, views, voxel)


def _agreed(accepting: torch.Tensor, views: torch.Tensor, least: int) -> torch.Tensor:
    return (views >= least) & (accepting >= (1 - _OUTVOTED) * views)


def _compare(shape: Silhouette, own: np.ndarray, volume: torch.Tensor, voxel: float, frame: int = 0) -> MaskVerdict:
    """A camera's `own` mask (h, w) against points of the others' volume."""
    camera, mask = shape.camera, (own >= 128).astype(np.uint8)
    pixels, depth = shape.project(volume)
    column, row = pixels.floor().long().T
    shown = (depth > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    radii = (_REACH * voxel * camera.fx / depth).ceil().clamp(1, max(mask.shape) // 8).long()  # closes gaps
    cover, reached, lacks = np.zeros((3, *mask.shape), bool)
    for radius in radii[shown].unique().tolist():
        disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        of = shown & (radii == radius)
        part = np.zeros(mask.shape, np.uint8)
        part[row[of], column[of]] = 1
        part = np.asarray(cv2.morphologyEx(part, cv2.MORPH_CLOSE, disk), np.uint8)
        cover |= part > 0
        reached |= cv2.dilate(part, disk) > 0
        lacks |= (part > 0) & (cv2.dilate(mask, disk) == 0)
    more = (mask > 0) & ~reached
    return MaskVerdict(
        camera.name,
        frame,
        int(lacks.sum()) / max(int(cover.sum()), 1),
        int(more.sum()) / max(int(mask.sum()), 1),
        box=_largest_box(more | lacks, shape.footprint / max(camera.fx, camera.fy)),
    )


def _largest_box(area: np.ndarray, enlarged: float) -> tuple[int, int, int, int] | None:
    """The box of the largest connected part of an area (H, W) bool, in pixels of an image enlarged by that factor."""
    count, _, stats, _ = cv2.connectedComponentsWithStats(area.astype(np.uint8), connectivity=8)
    if count == 1:
        return None
    left, top, width, height, _ = stats[1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())]
    left, top, right, bottom = (round(enlarged * float(side)) for side in (left, top, left + width, top + height))
    return left, top, right, bottom
