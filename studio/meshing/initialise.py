"""Masks to coloured points: the start of training."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import torch

from studio.errors import StudioError
from studio.meshing.blame import raise_disagreement
from studio.meshing.coloring import color_points
from studio.meshing.hull import Hull, HullSettings, carve, locate
from studio.meshing.sampling import sample_surface
from studio.meshing.silhouettes import Silhouettes, ViewLike
from studio.meshing.surface import Mesh, MeshViews, extract_surface
from studio.meshing.vote import restore
from studio.progress import ProgressFn, no_progress

_COMPARE_PIXELS = 120_000
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


@dataclass
class InitResult:
    """What training starts from.

    Attributes:
        mesh: surface of the visual hull.
        points: (N, 3) float32 on it; normals (N, 3) float32 unit; colors (N, 3) float32 0..1.
        disagreement: a camera each, 0..1: 1 - IoU of the hull's silhouette and the mask; above about 0.2 the mask or
            the pose of that camera deserves a look.
        views_per_point: (N,) int: how many cameras saw each point.
        warnings: sentences for the user: cameras whose masks were outvoted or disagree.
    """

    mesh: Mesh
    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    disagreement: dict[str, float]
    views_per_point: np.ndarray
    warnings: list[str]


def _part(progress: ProgressFn, start: int, stop: int) -> ProgressFn:
    """A step's own progress as a stretch of 0..100."""

    def inner(done: int, total: int, **figures: object) -> None:
        progress(start + round((stop - start) * done / max(total, 1)), 100, **figures)

    return inner


def _compare(mesh: Mesh, shapes: Silhouettes) -> tuple[list[np.ndarray], dict[str, float], dict[str, float]]:
    """Unexplained foreground (h, w) bool, 1 - IoU and uncovered share, a camera each."""
    import cv2

    rays = MeshViews(mesh) if len(mesh.faces) else None
    unexplained: list[np.ndarray] = []
    disagreement: dict[str, float] = {}
    uncovered: dict[str, float] = {}
    for name, camera, matte in zip(shapes.names, shapes.cameras, shapes.mattes, strict=True):
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
    shapes = Silhouettes(views, progress=_part(progress, 0, 20))
    # A point that few cameras see is carved by few: ask for many, and for fewer only where masks stay unexplained.
    shares = [0.5, 0.34, 0.2] if settings.min_view_share is None else [settings.min_view_share]
    tried: list[int] = []
    best: HullResult | None = None
    failure: StudioError | None = None
    for share in shares:
        min_views = min(len(shapes), max(2, round(share * len(shapes))))
        if min_views in tried:
            continue
        tried.append(min_views)
        try:
            result = _carve_once(shapes, settings, min_views, max_faces, lambda step: progress(20 + 10 * step, 100))
        except StudioError as error:
            failure = failure or error
            continue
        if best is None or np.mean(list(result.disagreement.values())) < np.mean(list(best.disagreement.values())):
            best = result
        # Cameras that disagree for reasons of their own would never be satisfied; the typical one decides.
        if np.quantile(list(best.uncovered.values()), 0.75) < 0.03:
            break
    if best is None:
        raise failure or StudioError("The visual hull is empty; check the masks and the camera poses.")
    progress(100, 100)
    return best


def _carve_once(
    shapes: Silhouettes, settings: HullSettings, min_views: int, max_faces: int, step: Callable[[int], None]
) -> HullResult:
    """Carve, vote, and take the surface, for one number of views."""
    hull, mesh = _zoomed(shapes, settings, min_views, max_faces, step)
    inside = max(int((hull.field > 0).sum()), 1)
    outvoted = {name: hull.outvoted.get(name, 0) / inside for name in shapes.names}
    gross = [name for name, share in outvoted.items() if share > _GROSS]
    if gross and len(shapes) - len(gross) >= 3:
        # Where such a mask is wrong it was outvoted, but it cannot be trusted at the seams either.
        hull, mesh = _zoomed(shapes.without(gross), settings, min_views, max_faces, step)
    _, disagreement, uncovered = _compare(mesh, shapes)
    step(7)
    return HullResult(hull, mesh, disagreement, uncovered, outvoted)


def _zoomed(
    shapes: Silhouettes, settings: HullSettings, min_views: int, max_faces: int, step: Callable[[int], None]
) -> tuple[Hull, Mesh]:
    """The voted hull at full resolution within its own bounds, and its surface, never empty."""
    allowed = settings.outvoted(len(shapes))
    min_views = min(min_views, len(shapes))
    bounds = locate(shapes, allowed, min_views)
    # The first bounds are loose where cameras overlap little: zoom in on what is really there.
    for _ in range(4):
        coarse, _ = _voted(shapes, bounds, min(96, settings.resolution), allowed, min_views)
        found = coarse.bounds()
        if found is None:
            _raise_empty(shapes, bounds, min_views)
        before, bounds = bounds, found
        step(1)
        if (bounds[1] - bounds[0]).max() > 0.7 * (before[1] - before[0]).max():
            break
    hull, mesh = _voted(shapes, bounds, settings.resolution, allowed, min_views, settings.smoothing, max_faces)
    if len(mesh.faces) == 0:
        _raise_empty(shapes, bounds, min_views)
    step(6)
    return hull, mesh


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
    smoothing: float = 0.0,
    max_faces: int = 100_000,
) -> tuple[Hull, Mesh]:
    """The hull within bounds, with what a few bad masks carved away given back, and its surface (may be empty)."""
    hull, tolerant = carve(shapes, bounds, resolution=resolution, allowed=allowed, min_views=min_views)
    mesh = extract_surface(hull, smoothing=smoothing, max_faces=max_faces)
    if allowed:
        unexplained, _, _ = _compare(mesh, shapes)
        voted = restore(hull, tolerant, shapes, unexplained)
        if voted.restored:
            return voted, extract_surface(voted, smoothing=smoothing, max_faces=max_faces)
    return hull, mesh


def initialise_points(
    views: Sequence[ViewLike],
    n_points: int = 50_000,
    *,
    settings: HullSettings | None = None,
    max_faces: int = 100_000,
    seed: int = 0,
    progress: ProgressFn = no_progress,
) -> InitResult:
    """Coloured points on the visual hull of one moment.

    Args:
        views: pinhole views of the moment with image and matte.
        n_points: how many points to sample.
        settings: how to carve.
        max_faces: upper bound of the mesh's faces.
        seed: of the sampling; the same inputs and seed give the same points.
        progress: called often; may raise `Cancelled`.

    Returns:
        mesh, points, normals, colours and how far the cameras disagree.

    Raises:
        StudioError: see `visual_hull`.
    """
    result = visual_hull(views, settings, max_faces=max_faces, progress=_part(progress, 0, 70))
    points, normals = sample_surface(result.mesh, n_points, seed=seed)
    colors, seen = color_points(
        points,
        normals,
        views,
        MeshViews(result.mesh),
        progress=_part(progress, 70, 100),
    )
    warnings = [
        f"Camera '{name}': the hull's silhouette and its mask differ by {value:.0%}; look at its mask and pose."
        for name, value in result.disagreement.items()
        if value > 0.25
    ]
    warnings += [
        f"Camera '{name}': its mask misses {value:.1%} of the volume that the other cameras agree on; it was outvoted."
        for name, value in result.outvoted.items()
        if value > 0.002
    ]
    return InitResult(result.mesh, points, normals, colors, result.disagreement, seen, warnings)
