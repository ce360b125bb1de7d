"""The visual hull and its surface from masks: chooses bounds and the required number of views, corrects outliers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import cv2
import numpy as np
import torch

from v3studio.studio.cameras import FootageView
from v3studio.studio.errors import StudioError
from v3studio.studio.meshing.hull import Bounds, Hull, Tick, carve, locate, raise_disagreement
from v3studio.studio.meshing.outlier_masks import restore
from v3studio.studio.meshing.settings import InitializeSettings
from v3studio.studio.meshing.silhouettes import Silhouette, silhouettes
from v3studio.studio.meshing.surface import Mesh, MeshViews, extract_surface, refined
from v3studio.studio.progress import ProgressFn, no_progress, part_of

_COMPARE_PIXELS = 120_000
_COARSE = 96  # voxels along the longest side while searching for bounds
_COARSE_FACES = 100_000
_SMOOTHING = 0.7  # of the field before the final surface, standard deviation in voxels
_VIEW_SHARES = (0.9, 0.7, 0.5, 0.34, 0.2)  # of the cameras, that must see a point of the hull
_GROSS = 0.05  # cameras that wrongly reject more than this fraction of the hull are excluded


@dataclass
class HullResult:
    """A visual hull, and how well it fits the masks."""

    hull: Hull
    mesh: Mesh  # its surface, never empty
    disagreement: dict[str, float]  # camera name to 1 - IoU of the hull's silhouette and the mask, 0..1
    # camera name to the fraction of the hull's voxels that its mask wrongly rejects, 0..1; above 0.05, it was excluded
    outlier_shares: dict[str, float]


def visual_hull(
    views: Sequence[FootageView], settings: InitializeSettings | None = None, *, progress: ProgressFn = no_progress
) -> HullResult:
    """Carve the visual hull of one frame and extract its surface, from at least two pinhole views, each read once.

    `progress` is called with percentages and may raise `Cancelled`. StudioError if cameras or masks are unusable (see
    `silhouettes`), or the hull is empty (see `raise_disagreement`).
    """
    settings = settings or InitializeSettings()
    shapes = silhouettes(views, progress=part_of(progress, 0, 20))

    def at(step: int) -> Tick:
        return lambda: progress(step, 100)

    coarse = _choose_min_views(shapes, settings, at(30))
    shares = _outlier_shares(coarse.hull, shapes)
    gross = [name for name, share in shares.items() if share > _GROSS]
    used = shapes
    if gross and len(shapes) - len(gross) >= 3:
        # These masks were ignored where they are wrong, but they are not reliable at the seams either.
        used = [shape for shape in shapes if shape.camera.name not in gross]
        coarse = _zoom(used, settings, min(coarse.hull.min_views, len(used)), at(50))
    hull, mesh = _carve_corrected(used, coarse.bounds, settings, coarse.hull.min_views, at(70), coarse=False)
    mesh = refined(mesh, settings.max_faces)
    if len(mesh.faces) == 0:
        _raise_empty(shapes, coarse.bounds, coarse.hull.min_views)
    _, disagreement, _ = _compare(mesh, shapes, at(95))
    small = {name: share for name, share in _outlier_shares(hull, shapes).items() if name not in gross}
    progress(100, 100)
    return HullResult(hull, mesh, disagreement, {**shares, **small})


def _outlier_shares(hull: Hull, shapes: list[Silhouette]) -> dict[str, float]:
    """Camera name to the fraction of the hull that its mask wrongly rejects."""
    inside = max(int((hull.field > 0).sum()), 1)
    return {shape.camera.name: hull.outliers.get(shape.camera.name, 0) / inside for shape in shapes}


@dataclass
class _Coarse:
    """A hull at low resolution, its bounds, and its differences from the masks."""

    hull: Hull
    bounds: Bounds
    disagreement: float  # mean of all cameras
    uncovered: float  # share of the masks in three quarters of the cameras: a few outlier masks are never covered


def _choose_min_views(shapes: list[Silhouette], settings: InitializeSettings, tick: Tick) -> _Coarse:
    """Choose the number of cameras that must see a point of the hull.

    Space that only a few cameras see is carved by only these, so its shape is unreliable. Nearly all cameras are
    required at first, and fewer only if masks remain uncovered because not every camera sees the whole performer.
    """
    best: _Coarse | None = None
    failure: StudioError | None = None
    for min_views in dict.fromkeys(min(len(shapes), max(2, round(share * len(shapes)))) for share in _VIEW_SHARES):
        try:
            candidate = _zoom(shapes, settings, min_views, tick)
        except StudioError as error:
            failure = failure or error
            continue
        if best is None or candidate.disagreement < best.disagreement - 0.01:
            best = candidate
        if best.uncovered < 0.04:
            break
    if best is None:
        assert failure is not None
        raise failure
    return best


def _zoom(shapes: list[Silhouette], settings: InitializeSettings, min_views: int, tick: Tick) -> _Coarse:
    """The hull at low resolution. Bounds are refined repeatedly: if cameras overlap little, they start too wide."""
    bounds = locate(shapes, settings.outvoted(len(shapes)), min_views, tick)
    for _ in range(4):
        hull, mesh = _carve_corrected(shapes, bounds, settings, min_views, tick, coarse=True)
        own = hull.bounds()
        if own is None:
            _raise_empty(shapes, bounds, min_views)
        before, bounds = bounds, own
        if (bounds[1] - bounds[0]).max() > 0.7 * (before[1] - before[0]).max():
            break
    _, disagreement, uncovered = _compare(refined(mesh, _COARSE_FACES), shapes, tick)
    share = float(np.quantile(list(uncovered.values()), 0.75))
    return _Coarse(hull, bounds, float(np.mean(list(disagreement.values()))), share)


def _raise_empty(shapes: list[Silhouette], bounds: Bounds, min_views: int) -> NoReturn:
    """Diagnose an empty hull on a grid of points within the bounds."""
    axes = [torch.linspace(float(low), float(high), 48) for low, high in zip(*bounds, strict=True)]
    raise_disagreement(shapes, torch.cartesian_prod(*axes), 0.0, min_views)


def _carve_corrected(
    shapes: list[Silhouette], bounds: Bounds, settings: InitializeSettings, min_views: int, tick: Tick, coarse: bool
) -> tuple[Hull, Mesh]:
    """The hull within bounds, corrected for outlier masks, and its surface, not refined (may be empty)."""
    allowed = settings.outvoted(len(shapes))
    resolution, smoothing = (min(_COARSE, settings.resolution), 0.0) if coarse else (settings.resolution, _SMOOTHING)
    hull, tolerant = carve(shapes, bounds, resolution, allowed, min_views, tick)
    surface = extract_surface(hull, smoothing)
    if allowed:
        uncovered_areas, _, _ = _compare(surface, shapes, tick)
        corrected = restore(hull, tolerant, shapes, uncovered_areas, tick)
        if corrected is not hull:  # the same object if there is nothing to correct
            hull, surface = corrected, extract_surface(corrected, smoothing)
    return hull, surface


def _compare(
    mesh: Mesh, shapes: list[Silhouette], tick: Tick
) -> tuple[list[np.ndarray], dict[str, float], dict[str, float]]:
    """Return per camera: uncovered foreground (h, w) bool, 1 - IoU, and the uncovered share of the mask."""
    rays = MeshViews(mesh) if len(mesh.faces) else None
    uncovered_areas: list[np.ndarray] = []
    disagreement: dict[str, float] = {}
    uncovered: dict[str, float] = {}
    for camera, mask in ((shape.camera, shape.mask) for shape in shapes):
        tick()
        small = camera.scaled(min(1.0, float(np.sqrt(_COMPARE_PIXELS / mask.size))))
        cover = np.isfinite(rays.depth(small)) if rays else np.zeros((small.height, small.width), bool)
        foreground = cv2.resize(mask, (small.width, small.height), interpolation=cv2.INTER_AREA) >= 128
        union = int((cover | foreground).sum())
        disagreement[camera.name] = 1.0 - int((cover & foreground).sum()) / union if union else 0.0
        gap = foreground & ~cover
        uncovered[camera.name] = int(gap.sum()) / max(int(foreground.sum()), 1)
        # Thin rims are caused by smoothing and small calibration errors; a missing limb is thicker.
        gap = cv2.morphologyEx(gap.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        gap = cv2.dilate(gap, np.ones((3, 3), np.uint8)) * foreground.astype(np.uint8)
        uncovered_areas.append(cv2.resize(gap, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST) > 0)
    return uncovered_areas, disagreement, uncovered
