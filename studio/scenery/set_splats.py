"""Splats of the set behind a performer, trained once for a take from images of it in which nobody is.

Their first means are on surfaces that several cameras agree on (`studio.scenery.depths`), as many to an image in
each camera, so that they are fine where cameras are near. Each camera sees them in colors of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.cameras import Camera
from v3studio.studio.color_fit import correct_color, fit_color, neutral, uncorrected
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.masks.filters import reduced
from v3studio.studio.metrics import psnr
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.scenery.depths import DepthMap, looked_at, unprojected
from v3studio.studio.training.keyframe import scene_extent, train_keyframe
from v3studio.studio.training.settings import LearningRates, TrainSettings
from v3studio.studio.training.step import Checkpoint, CheckpointFn
from v3studio.studio.training.views import TrainingView

_POINTS = 24_000
_UNSURE = 0.15
"""Share of the points whose depth no other camera confirms: where there are no others, something has to begin."""
_FIRST_OPACITY = 0.5  # most first points are on surfaces
_COARSE = 0.5
"""Scale of the plates until pruning."""
_RIDGE, _ROUNDS = 1e-3, 5  # of the cameras' colors
_NEAR = 0.25
"""Depth before a camera, relative to that of what the rig looks at, up to which there is no set."""
_BEFORE = 0.8
"""Depth relative to that of the set behind it, up to which a splat is in the air."""
_MANY = 3
"""Cameras that see a splat in the air before it is removed."""

SETTINGS = TrainSettings(
    keyframe_iterations=1000,
    densify_from=200,
    densify_until=800,
    densify_max_splats=44_000,
    prune_ratio=0.15,
    prune_by="contribution",
    max_splats=40_000,
    prune_finetune_iterations=250,
    scale_reg=0.02,
    opacity_reg=0.005,
    dropout=0.05,
    alpha_weight=0.05,
    refine_masks="never",
    chroma_siting="none",
)


@dataclass(frozen=True, eq=False)
class SetPoints:
    """First points (N, 3) of the set with colors (N, 3), 0 to 1, those of the mean camera; and by camera the (3, 4)
    float64 matrix from these to its own."""

    means: Tensor
    colors: Tensor
    matrices: dict[str, Tensor]


def first_points(maps: Sequence[DepthMap], plates: Mapping[str, np.ndarray], seed: int = 0) -> SetPoints:
    """Choose points of depth maps, as many in each camera; `plates`: as `FootageView.plate`."""
    import cv2

    draw = np.random.default_rng(seed)
    points, seen_by = [], []
    images = {
        each.camera.name: cv2.resize(plates[each.camera.name], each.depth.shape[::-1], interpolation=cv2.INTER_AREA)
        for each in maps
    }
    for number, each in enumerate(maps):
        image = images[each.camera.name]
        known = np.ones(each.depth.shape, bool) if image.shape[2] == 3 else image[..., 3] == 255
        for where, share in ((each.sure & known, 1 - _UNSURE), (~each.sure & known, _UNSURE)):
            places = np.flatnonzero(where)
            chosen = draw.permutation(places)[: int(share * _POINTS / len(maps))]
            points.append(unprojected(each.camera, each.depth).reshape(-1, 3)[chosen])
            seen_by.append(np.full(len(chosen), number))
    means = np.concatenate(points)
    keep = ~in_the_air(means, maps, [each.camera for each in maps])
    means, owner = means[keep], np.concatenate(seen_by)[keep]
    colors, seen = _colors(means, owner, maps, images)
    mean, matrices = _color_matrices(colors, seen)
    names = [each.camera.name for each in maps]
    return SetPoints(torch.from_numpy(means).float(), mean.float().clamp(0, 1), dict(zip(names, matrices, strict=True)))


def _colors(
    means: np.ndarray, owner: np.ndarray, maps: Sequence[DepthMap], images: Mapping[str, np.ndarray]
) -> tuple[Tensor, Tensor]:
    """(C, N, 3) float64 colors of points in each camera, and (C, N) bool where it sees them."""
    colors, seen = np.zeros((len(maps), len(means), 3)), np.zeros((len(maps), len(means)), bool)
    for number, each in enumerate(maps):
        at, inside, z = _pixels(each.camera, means)
        image = images[each.camera.name].reshape(-1, images[each.camera.name].shape[2])[at]
        known = image[:, 3] == 255 if image.shape[1] == 4 else np.ones(len(at), bool)
        agrees = np.abs(each.depth.reshape(-1)[at] - z) < 0.04 * z
        seen[number] = inside & known & (agrees | (owner == number))
        colors[number] = image[:, :3] / 255
    return torch.from_numpy(colors), torch.from_numpy(seen)


def _pixels(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The flat index of the pixel of each point, whether it is in the image, and its depth."""
    pixels, z = camera.project(points)
    column, row = np.nan_to_num(pixels, nan=-1, posinf=-1, neginf=-1).clip(-1, 1e6).astype(int).T
    inside = (z > 0) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    return np.where(inside, row * camera.width + column, 0), inside, z


def _color_matrices(colors: Tensor, seen: Tensor) -> tuple[Tensor, Tensor]:
    """The (N, 3) colors of points in the mean camera, and each camera's (3, 4) matrix from them to its own."""
    weights = seen.double()[..., None]
    matrices = neutral().repeat(len(colors), 1, 1)
    shared = (seen.sum(0) > 1).double()
    ones = torch.ones(colors.shape[1], dtype=torch.float64)
    mean = (colors * weights).sum(0) / weights.sum(0).clamp_min(1)
    for _ in range(_ROUNDS):
        fits = zip(colors, seen, strict=True)
        matrices = torch.stack([fit_color(mean, ones, own, own_seen * shared, _RIDGE) for own, own_seen in fits])
        matrices = matrices - matrices.mean(0) + neutral()
        own = torch.stack([uncorrected(each, matrix) for each, matrix in zip(colors, matrices, strict=True)])
        mean = (own * weights).sum(0) / weights.sum(0).clamp_min(1)
    return mean, matrices


def train_set(
    plates: Mapping[str, np.ndarray],
    cameras: Sequence[Camera],
    first: SetPoints,
    maps: Sequence[DepthMap],
    rig: Sequence[Camera],
    *,
    dilation: float,
    device: str = "cpu",
    seed: int = 0,
    progress: ProgressFn = no_progress,
    checkpoint: CheckpointFn | None = None,
    resume: Checkpoint | None = None,
) -> Gaussians:
    """Train the splats of a set; for the arguments that are not named here, see `train_keyframe`.

    Args:
        plates: by camera, as `FootageView.plate`; what is not reliable is not learned.
        cameras: of the plates.
        first, maps: see `first_points` and `depth_maps`.
        rig: all cameras, before which there is nothing.
        dilation: see `TrainSettings`.

    Returns:
        Detached splats of SH degree 0, none of them in the air before cameras.
    """

    def view(camera: Camera, scale: float) -> TrainingView:
        plate = reduced(plates[camera.name], max(1, round(scale * max(camera.width, camera.height))))
        camera = camera.resized(plate.shape[1], plate.shape[0])
        image = torch.from_numpy(np.ascontiguousarray(plate[..., :3])).to(device)
        everywhere = torch.full(plate.shape[:2], 255, dtype=torch.uint8, device=device)
        seen = TrainingView(camera, image, everywhere).with_color(first.matrices[camera.name])
        seen.hidden = None if plate.shape[2] == 3 else torch.from_numpy(plate[..., 3] < 255).to(device)
        return seen

    # the rates of means are for a performer's size; what is far away does not make the near move faster
    middle, extent = looked_at(cameras), scene_extent(first.means)
    size = 2 * float(np.median([np.linalg.norm(camera.center - middle) for camera in cameras]))
    rate = LearningRates().means * min(1.0, size / extent)
    settings = SETTINGS.replace(dilation=dilation, rates=LearningRates(means=rate))

    def wanted(splats: Gaussians) -> Tensor:
        radii = splats.scales.amax(-1).double().cpu().numpy()
        air = in_the_air(splats.means.double().cpu().numpy(), maps, rig, radii)
        return torch.from_numpy(~air).to(device)

    splats = train_keyframe(
        [view(camera, 1.0) for camera in cameras],
        first.means.to(device),
        first.colors.to(device),
        settings,
        seed=seed,
        progress=progress,
        checkpoint=checkpoint,
        resume=resume,
        coarse=[view(camera, _COARSE) for camera in cameras],
        wanted=wanted,
        first_opacity=_FIRST_OPACITY,
    )
    return splats[wanted(splats)]


def in_the_air(
    means: np.ndarray, maps: Sequence[DepthMap], rig: Sequence[Camera], radii: np.ndarray | float = 0.0
) -> np.ndarray:
    """(N,) bool: points (N, 3) close before a camera of the rig, or before what most of the cameras of `maps` that see
    them have found behind them; `radii`: (N,) those of splats, world units."""
    before, behind = np.zeros(len(means), int), np.zeros(len(means), int)
    for each in maps:
        at, inside, z = _pixels(each.camera, means)
        sure, depth = each.sure.reshape(-1)[at], each.depth.reshape(-1)[at]
        before += inside & sure & (z < _BEFORE * depth)
        behind += inside & sure & (z >= _BEFORE * depth)
    middle, close = looked_at(rig), np.zeros(len(means), bool)
    for camera in rig:
        pixels, z = camera.project(means)
        size = np.broadcast_to(radii * camera.fx / np.maximum(z, 1e-6), len(means))
        off = np.abs(np.nan_to_num(pixels, nan=1e9) - [camera.cx, camera.cy])
        reach = np.array([camera.width, camera.height]) / 2 + 2 * size[:, None]
        close |= (z > 0) & (z < _NEAR * (middle - camera.center) @ camera.forward) & (off < reach).all(1)
        close |= np.linalg.norm(means - camera.center, axis=1) < 2 * radii
    return close | ((before >= _MANY) & (before > behind))


def plate_psnr(
    splats: Gaussians, cameras: Sequence[Camera], plates: Mapping[str, np.ndarray], matrices: Mapping[str, Tensor]
) -> dict[str, float]:
    """PSNR in dB of the splats against plates, as `FootageView.plate`, by camera, where they are reliable."""
    figures = {}
    for camera in cameras:
        plate = torch.from_numpy(plates[camera.name]).float() / 255
        render = rasterize(splats, camera, torch.zeros(3, device=splats.device))
        image = correct_color(render.image, render.alpha, matrices[camera.name]).clamp(0, 1).cpu()
        known = None if plate.shape[2] == 3 else plate[..., 3]
        figures[camera.name] = round(float(psnr(image, plate[..., :3], known)), 2)
    return figures
