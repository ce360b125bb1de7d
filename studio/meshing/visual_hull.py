"""Masks to the surface of their visual hull: how many cameras must agree, zooming in, the vote."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import torch

from studio.errors import StudioError
from studio.meshing.diagnostics import raise_disagreement
from studio.meshing.hull import Hull, HullSettings, Tick, carve, locate
from studio.meshing.outlier_masks import restore
from studio.meshing.silhouettes import Silhouettes
from studio.meshing.steps import part_of
from studio.meshing.surface import Mesh, MeshViews, extract_surface
from studio.progress import ProgressFn, no_progress
from studio.views import ViewLike

_COMPARE_PIXELS = 120_000
_COARSE = 96  # voxels along the longest side while looking for bounds
_GROSS = 0.05  # outvoted on more than this share of the hull, a camera is left out


@dataclass
class HullResult:
    """A carved hull and how well it explains the masks.

    Attributes:
        hull: the field.
        mesh: its surface, never empty.
        disagreement: a camera each, 0..1: 1 - IoU of the hull's silhouette and the mask.
        uncovered: a camera each, 0..1: share of the mask that the hull leaves unexplained.
        outvoted: a camera each: share of the hull's voxels which this camera's mask refused and was outvoted on; a
            camera with more than 0.05 was left out.
    """

    hull: Hull
    mesh: Mesh
    disagreement: dict[str, float]
    uncovered: dict[str, float]
    outvoted: dict[str, float]


def visual_hull(
    views: Sequence[ViewLike],
    settings: HullSettings | None = None,
    *,
    max_faces: int = 100_000,
    progress: ProgressFn = no_progress,
) -> HullResult:
    """Carve the visual hull of one moment and take its surface.

    Args:
        views: at least two views with pinhole cameras; read once each (a lazy sequence is fine).
        settings: how to carve.
        max_faces: upper bound of the mesh's faces.
        progress: called with steps done; may raise `Cancelled`.

    Returns:
        the hull, its mesh, and how far each camera disagrees.

    Raises:
        StudioError: too few views, unusable cameras or masks, or a hull that is empty: says whose masks disagree.
    """
    settings = settings or HullSettings()
    shapes = Silhouettes(views, progress=part_of(progress, 0, 20))

    def at(step: int) -> Tick:
        return lambda: progress(step, 100)

    coarse = _agree(shapes, settings, at(30))
    outvoted = _outvoted(coarse.hull, shapes)
    gross = [name for name, share in outvoted.items() if share > _GROSS]
    used = shapes
    if gross and len(shapes) - len(gross) >= 3:
        # Where such a mask is wrong it was outvoted, but it cannot be trusted at the seams either.
        used = shapes.without(gross)
        coarse = _zoom(used, settings, min(coarse.hull.min_views, len(used)), at(50))
    hull, mesh = _voted(
        used,
        coarse.bounds,
        settings.resolution,
        settings.outvoted(len(used)),
        coarse.hull.min_views,
        at(70),
        settings.smoothing,
        max_faces,
    )
    if len(mesh.faces) == 0:
        _raise_empty(shapes, coarse.bounds, coarse.hull.min_views)
    _, disagreement, uncovered = _compare(mesh, shapes, at(95))
    small = {name: share for name, share in _outvoted(hull, shapes).items() if name not in gross}
    progress(100, 100)
    return HullResult(hull, mesh, disagreement, uncovered, {**outvoted, **small})


def _outvoted(hull: Hull, shapes: Silhouettes) -> dict[str, float]:
    """Share of the hull that each camera's mask refused in vain."""
    inside = max(int((hull.field > 0).sum()), 1)
    return {name: hull.outvoted.get(name, 0) / inside for name in shapes.names}


@dataclass
class _Coarse:
    """A hull at low resolution within bounds that fit it, and how it differs from the masks."""

    hull: Hull
    bounds: tuple[np.ndarray, np.ndarray]
    disagreement: dict[str, float]
    uncovered: dict[str, float]

    @property
    def mean_disagreement(self) -> float:
        return float(np.mean(list(self.disagreement.values())))


def _agree(shapes: Silhouettes, settings: HullSettings, tick: Tick) -> _Coarse:
    """Find how many cameras must see a point of the hull.

    What few cameras see, few carve, so it may be anything: ask for nearly all, and for fewer only where masks stay
    unexplained because the cameras do not all see the whole thing.
    """
    shares = [0.9, 0.7, 0.5, 0.34, 0.2] if settings.min_view_share is None else [settings.min_view_share]
    best: _Coarse | None = None
    failure: StudioError | None = None
    for min_views in dict.fromkeys(min(len(shapes), max(2, round(share * len(shapes)))) for share in shares):
        try:
            found = _zoom(shapes, settings, min_views, tick)
        except StudioError as error:
            failure = failure or error
            continue
        if best is None or found.mean_disagreement < best.mean_disagreement - 0.01:
            best = found
        # Cameras that disagree for reasons of their own would never be satisfied; the typical one decides.
        if np.quantile(list(best.uncovered.values()), 0.75) < 0.04:
            break
    if best is None:
        raise failure or StudioError("The visual hull is empty; check the masks and the camera poses.")
    return best


def _zoom(shapes: Silhouettes, settings: HullSettings, min_views: int, tick: Tick) -> _Coarse:
    """The hull at low resolution; bounds are loose at first where cameras overlap little."""
    allowed = settings.outvoted(len(shapes))
    bounds = locate(shapes, allowed, min_views)
    for _ in range(4):
        hull, mesh = _voted(shapes, bounds, min(_COARSE, settings.resolution), allowed, min_views, tick)
        found = hull.bounds()
        if found is None:
            _raise_empty(shapes, bounds, min_views)
        before, bounds = bounds, found
        if (bounds[1] - bounds[0]).max() > 0.7 * (before[1] - before[0]).max():
            break
    _, disagreement, uncovered = _compare(mesh, shapes, tick)
    return _Coarse(hull, bounds, disagreement, uncovered)


def _raise_empty(shapes: Silhouettes, bounds: tuple[np.ndarray, np.ndarray], min_views: int) -> NoReturn:
    """Ask all cameras about a grid of points within the bounds."""
    axes = [torch.linspace(float(low), float(high), 48) for low, high in zip(*bounds, strict=True)]
    raise_disagreement(shapes, torch.cartesian_prod(*axes), 0.0, min_views)


def _voted(
    shapes: Silhouettes,
    bounds: tuple[np.ndarray, np.ndarray],
    resolution: int,
    allowed: int,
    min_views: int,
    tick: Tick,
    smoothing: float = 0.0,
    max_faces: int = 100_000,
) -> tuple[Hull, Mesh]:
    """The hull within bounds, with what a few bad masks carved away given back, and its surface (may be empty)."""
    hull, tolerant = carve(shapes, bounds, resolution=resolution, allowed=allowed, min_views=min_views, tick=tick)
    mesh = extract_surface(hull, smoothing=smoothing, max_faces=max_faces)
    if allowed:
        unexplained, _, _ = _compare(mesh, shapes, tick)
        voted = restore(hull, tolerant, shapes, unexplained, tick)
        if voted.restored:
            return voted, extract_surface(voted, smoothing=smoothing, max_faces=max_faces)
    return hull, mesh


def _compare(
    mesh: Mesh, shapes: Silhouettes, tick: Tick
) -> tuple[list[np.ndarray], dict[str, float], dict[str, float]]:
    """Unexplained foreground (h, w) bool, 1 - IoU and uncovered share, a camera each."""
    import cv2

    rays = MeshViews(mesh) if len(mesh.faces) else None
    unexplained: list[np.ndarray] = []
    disagreement: dict[str, float] = {}
    uncovered: dict[str, float] = {}
    for name, camera, matte in zip(shapes.names, shapes.cameras, shapes.mattes, strict=True):
        tick()
        small = camera.scaled(min(1.0, float(np.sqrt(_COMPARE_PIXELS / matte.size))))
        cover = np.isfinite(rays.depth(small)) if rays else np.zeros((small.height, small.width), bool)
        mask = cv2.resize(matte, (small.width, small.height), interpolation=cv2.INTER_AREA) >= 128
        union = int((cover | mask).sum())
        disagreement[name] = 1.0 - int((cover & mask).sum()) / union if union else 0.0
        gap = mask & ~cover
        uncovered[name] = int(gap.sum()) / max(int(mask.sum()), 1)
        # Thin rims come from smoothing and small calibration errors; a lost limb is thicker than that.
        gap = cv2.morphologyEx(gap.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        gap = cv2.dilate(gap, np.ones((3, 3), np.uint8)) * mask.astype(np.uint8)
        unexplained.append(cv2.resize(gap, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST) > 0)
    return unexplained, disagreement, uncovered
