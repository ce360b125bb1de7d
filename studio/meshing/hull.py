"""The visual hull: the part of space that is inside all masks.

Carving is coarse to fine: a cube that contains the whole rig is split into cells. Cells that are certainly outside the
silhouettes of more cameras than tolerated are discarded; the others are split again. The remaining cells give the
bounds of a voxel grid, on which the signed distance to the hull is evaluated in a band around its surface. No
assumptions are made about the units, orientation or size of the scene.

A single bad mask must not carve away a limb, but tolerating outliers everywhere would inflate every hull. Therefore the
hull is carved strictly, and outlier masks are corrected afterwards (`studio.meshing.outlier_masks`).
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import torch

from v3studio.studio.cameras import nearest_point_to_rays
from v3studio.studio.errors import StudioError
from v3studio.studio.meshing.silhouettes import Silhouette, votes

_CHUNK = 1 << 18

Bounds = tuple[np.ndarray, np.ndarray]  # lower and upper corner, (3,) each, in world units
Tick = Callable[[], None]  # called several times per second during long computations; may raise `Cancelled`


@dataclass
class Hull:
    """A signed distance field on a voxel grid."""

    # (Z, Y, X) float32 in world units, positive inside, clamped to +-`band`; border voxels are outside
    field: np.ndarray
    origin: np.ndarray  # (3,) float64 world position of the center of voxel [0, 0, 0]
    voxel: float  # edge length of a voxel in world units
    band: float  # distance to which the field is clamped, in world units
    min_views: int  # number of cameras that had to see a point
    # camera name to the number of voxels that it rejected and that were restored, since it is an outlier
    outliers: dict[str, int] = dataclasses.field(default_factory=dict)

    def bounds(self) -> Bounds | None:
        """Bounds of the voxels that may be inside, plus one voxel; None if there are none."""
        near = np.argwhere(self.field > -self.voxel)[:, ::-1]
        if len(near) == 0:
            return None
        return self.origin + self.voxel * (near.min(axis=0) - 1), self.origin + self.voxel * (near.max(axis=0) + 1)

    def points(self, index: np.ndarray) -> np.ndarray:
        """World positions (N, 3) float64 of the voxels with flat indices (N,)."""
        z, y, x = np.unravel_index(index, self.field.shape)
        return self.origin + self.voxel * np.stack([x, y, z], 1)


def _cells(parents: torch.Tensor, size: float, split: int) -> torch.Tensor:
    """Centers (N * split^3, 3) of the cells into which cubes with centers (N, 3) and edge `size` are split."""
    steps = ((torch.arange(split, dtype=torch.float32) + 0.5) / split - 0.5) * size
    offsets = torch.cartesian_prod(steps, steps, steps)
    return (parents[:, None] + offsets[None]).reshape(-1, 3)


def _keep(
    shapes: list[Silhouette], centers: torch.Tensor, size: float, allowed: int, min_views: int, tick: Tick
) -> torch.Tensor:
    """(N,) bool: cells that may contain a part of the hull."""
    kept = torch.empty(len(centers), dtype=torch.bool)
    radius = size * math.sqrt(3) / 2
    for start in range(0, len(centers), _CHUNK):
        part = centers[start : start + _CHUNK]
        tick()
        alive = torch.arange(len(part))
        rejections = torch.zeros(len(part), dtype=torch.int16)
        views = torch.zeros(len(part), dtype=torch.int16)
        for shape in shapes:
            rejected, seen = shape.touches(part[alive], radius)
            rejections[alive] += rejected
            views[alive] += seen
            # Skip cells that are already discarded.
            alive = alive[rejections[alive] <= allowed]
            if len(alive) == 0:
                break
        kept[start : start + _CHUNK] = (rejections <= allowed) & (views >= min_views)
    return kept


def _start(shapes: list[Silhouette]) -> tuple[np.ndarray, float]:
    """Center (3,) and edge length of a cube that contains everything that the cameras may look at."""
    origins, directions = [], []
    for camera, box in ((shape.camera, shape.box) for shape in shapes):
        if box is None:
            continue
        middle = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, 1.0])
        ray = camera.rotation.T @ np.linalg.solve(camera.K, middle)
        origins.append(camera.center)
        directions.append(ray / np.linalg.norm(ray))
    at, to = np.array(origins), np.array(directions)
    centers = np.array([shape.camera.center for shape in shapes])
    spread = np.linalg.norm(centers - centers.mean(0), axis=1).max()
    # Nearest point to all rays, with lower weights for masks whose center is far off.
    weights = np.ones(len(at))
    center = centers.mean(0)
    for _ in range(10):
        center = nearest_point_to_rays(at, to, weights)
        away = center - at
        error = np.linalg.norm(away - (away * to).sum(1, keepdims=True) * to, axis=1)
        weights = 1 / np.maximum(error, 1e-3 * max(spread, 1e-12))
    reach = np.linalg.norm(centers - center, axis=1).max()
    return center, 2.0 * float(max(reach, spread, 1e-9))


def locate(shapes: list[Silhouette], allowed: int, min_views: int, tick: Tick) -> Bounds:
    """Bounds of the volume that the masks agree on; a few percent too wide."""
    center, edge = _start(shapes)
    cells = torch.from_numpy(center[None].astype(np.float32))
    split, before = 16, math.inf
    for _ in range(16):
        candidates = _cells(cells, edge, split)
        edge /= split
        split = 2
        kept = candidates[_keep(shapes, candidates, edge, allowed, min_views, tick)]
        if len(kept) == 0:
            raise_disagreement(shapes, candidates, edge * math.sqrt(3) / 2, min_views)
        cells = kept
        low, high = cells.amin(0) - edge / 2, cells.amax(0) + edge / 2
        longest = float((high - low).max())
        # Large cells are kept because they extend beyond the images; continue until the bounds converge.
        if (longest > 48 * edge and longest > 0.9 * before) or len(cells) > 200_000:
            break
        before = longest
    return low.double().numpy(), high.double().numpy()


def _evaluate(
    shapes: list[Silhouette], points: torch.Tensor, allowed: int, min_views: int, band: float, tick: Tick
) -> tuple[torch.Tensor, torch.Tensor]:
    """Strict field values (N,) clamped to +-band; and (N,) bool, true where at most `allowed` cameras reject."""
    strict, tolerated = torch.empty(len(points)), torch.empty(len(points), dtype=torch.bool)
    # Neighboring cameras are redundant: visit cameras in strides around the rig to discard outside points early.
    stride = max(1, round(len(shapes) * 0.382))
    while math.gcd(stride, len(shapes)) > 1:
        stride += 1
    order = [shapes[index * stride % len(shapes)] for index in range(len(shapes))]
    for start in range(0, len(points), _CHUNK):
        part = points[start : start + _CHUNK]
        tick()
        least = torch.full((len(part),), band)
        rejections = torch.zeros(len(part), dtype=torch.int16)
        views = torch.zeros(len(part), dtype=torch.int16)
        alive = torch.arange(len(part))
        for turn, shape in enumerate(order):
            value, seen = shape.distance(part[alive])
            value = torch.where(seen, value.clamp(-band, band), band)
            least[alive] = torch.minimum(least[alive], value)
            rejections[alive] += value <= 0
            views[alive] += seen
            if turn % 4 == 3:
                alive = alive[(rejections[alive] <= allowed) | (least[alive] > -band)]
        # Points that were discarded early were seen and rejected by enough cameras.
        few = (views < min_views) & (rejections <= allowed)
        least[few] = -band
        strict[start : start + _CHUNK] = least
        tolerated[start : start + _CHUNK] = (rejections <= allowed) & ~few
    return strict, tolerated


def carve(
    shapes: list[Silhouette], bounds: Bounds, resolution: int, allowed: int, min_views: int, tick: Tick
) -> tuple[Hull, np.ndarray]:
    """Carve the hull within bounds: the strict hull; and (Z, Y, X) bool on the same grid, true where at most `allowed`
    cameras reject.

    `resolution`: voxels along the longest side; fewer if pixels are coarser. `allowed` cameras may be outliers,
    `min_views` must see a point.
    """
    low, high = bounds
    middle = (low + high) / 2
    footprint = float(np.median([np.linalg.norm(shape.camera.center - middle) / shape.footprint for shape in shapes]))
    # Voxels smaller than half a pixel's footprint add no detail.
    voxel = max(float((high - low).max()) / resolution, 0.5 * footprint)
    block = 8
    counts = np.maximum(np.ceil((high - low + 4 * voxel) / (block * voxel)).astype(int), 1)
    corner = middle - counts * block * voxel / 2  # outer corner of the grid
    axes = [torch.arange(n, dtype=torch.float32) for n in counts]
    blocks = torch.cartesian_prod(*axes).to(torch.int64)  # (N, 3) x, y, z
    base = torch.from_numpy(corner.astype(np.float32))
    size = block
    # A cell is kept as long as a part of it, or of the band around it, may be inside.
    band = 3.0 * voxel
    while True:
        centers = base + (blocks.float() + 0.5) * (size * voxel)
        blocks = blocks[_keep(shapes, centers, size * voxel + band / 2, allowed, min_views, tick)]
        if size == 4:
            break
        size //= 2
        blocks = _voxels(blocks, 2)
    # Voxels of cells that are entirely inside need no evaluation.
    centers = base + (blocks.float() + 0.5) * (size * voxel)
    reach = 1.2 * (size * voxel * math.sqrt(3) / 2 + band)
    whole = _evaluate(shapes, centers, allowed, min_views, reach, tick)[0] >= reach
    strict, tolerated = _evaluate(
        shapes, base + (_voxels(blocks[~whole], size).float() + 0.5) * voxel, allowed, min_views, band, tick
    )
    shape = tuple(int(n) * block for n in counts[::-1])
    field, tolerant = np.full(shape, -band, np.float32), np.zeros(shape, bool)
    for grid, inside, values in ((field, band, strict), (tolerant, True, tolerated)):
        grid[tuple(_voxels(blocks[whole], size).flip(1).T.numpy())] = inside
        grid[tuple(_voxels(blocks[~whole], size).flip(1).T.numpy())] = values.numpy()
        for side in (grid[0], grid[-1], grid[:, 0], grid[:, -1], grid[:, :, 0], grid[:, :, -1]):
            side.fill(-band if grid is field else False)
    return Hull(field, corner + voxel / 2, voxel, band, min_views), tolerant


def _voxels(blocks: torch.Tensor, size: int) -> torch.Tensor:
    """Voxel indices (N * size^3, 3) x, y, z of blocks (N, 3)."""
    steps = torch.cartesian_prod(*[torch.arange(size)] * 3)
    return (blocks[:, None] * size + steps[None]).reshape(-1, 3)


def raise_disagreement(shapes: list[Silhouette], points: torch.Tensor, slack: float, min_views: int) -> NoReturn:
    """Raise an error that names the cameras that reject the (N, 3) float32 world points, covering the expected hull, on
    which most other cameras agree. `slack`: distance in world units by which a point may be outside a silhouette cone;
    `min_views`: number of cameras that must see a point."""
    accepted, sees = votes(shapes, points, slack)
    rejected, views = sees & ~accepted, sees.sum(0)
    names, count = [shape.camera.name for shape in shapes], len(shapes)
    most = int(views.max())
    if most < min_views:
        problem = (
            f"The visual hull is empty: no point is seen by more than {most} of {count} cameras, but {min_views} are "
            "required"
        )
        raise StudioError("hull.no_overlap", problem, value=most, fix="Check the camera poses.", expected=min_views)
    agreement = accepted.sum(0).float() / views.clamp_min(1)
    agreement[views < min_views] = -1
    top = agreement >= agreement.max() - 1e-6
    share = rejected[:, top].float().mean(1)
    outliers = [names[i] for i in torch.argsort(share, descending=True).tolist() if share[i] > 0.25]
    empty = [shape.camera.name for shape in shapes if shape.box is None]
    hint = f" (empty masks: {', '.join(empty)})" if empty else ""
    cameras = outliers or names
    problem = f"The visual hull is empty: the masks of {', '.join(cameras)}"
    if 0 < len(outliers) <= count // 2:
        problem += f"{hint} disagree with those of the other {count - len(outliers)} cameras"
        fix = "Fix these masks, or exclude these cameras."
    else:
        problem += f" have no common volume{hint}"
        fix = "Check the camera poses and the masks."
    raise StudioError("hull.masks_disagree", problem, fix=fix, cameras=tuple(cameras), empty=tuple(empty))
