"""Colors of surface points, from the views in which they are visible."""

from collections.abc import Sequence

import cv2
import numpy as np

from v3studio.studio.cameras import Camera, FootageView
from v3studio.studio.meshing.surface import MeshViews, open3d
from v3studio.studio.progress import ProgressFn, no_progress


def _bilinear(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N, ...) float32 bilinear samples of an image at pixels (N, 2), with the origin at the image corner."""
    if len(pixels) == 0:  # which OpenCV refuses
        return np.zeros((0, *image.shape[2:]), np.float32)
    at = (pixels - 0.5).astype(np.float32)  # cv2's origin is the center of the first pixel
    row = 16384
    rows = -(-len(at) // row)  # cv2.remap supports destinations up to 32766 pixels wide
    padded = np.zeros((rows * row, 2), np.float32)
    padded[: len(at)] = at
    grid = padded.reshape(rows, row, 2)
    out = cv2.remap(image, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return out.reshape(rows * row, *image.shape[2:])[: len(at)].astype(np.float32)


def color_points(
    points: np.ndarray,
    normals: np.ndarray,
    views: Sequence[FootageView],
    rays: MeshViews,
    *,
    best: int = 4,
    max_pixels: int = 300_000,
    progress: ProgressFn = no_progress,
) -> np.ndarray:
    """Color every point with the median of its best views, each of which is read once.

    A point is visible in a view if it projects into the image and the mask, faces the camera, and is not occluded by
    the mesh (tested with a depth map of reduced size). Views are ranked by viewing angle and distance. Takes (N, 3)
    world coordinates and unit normals; returns (N, 3) float32 colors in 0..1. Points that are not visible take the
    color of the nearest visible point; if none is visible, all are gray.
    """
    count = len(points)
    scores = np.zeros((best, count), np.float32)
    best_colors = np.zeros((best, count, 3), np.float32)
    for index, view in enumerate(views):
        camera: Camera = view.camera
        pixels, depth = camera.project(points)
        toward = camera.center - points
        distance = np.linalg.norm(toward, axis=1)
        facing = (toward * normals).sum(1) / np.maximum(distance, 1e-12)
        inside = (depth > 0) & (pixels >= 0).all(1) & (pixels <= [camera.width, camera.height]).all(1)
        candidates = np.flatnonzero(inside & (facing > 0.1))
        progress(index, len(views))
        if len(candidates) == 0:
            continue
        reduced = camera.scaled(min(1.0, float(np.sqrt(max_pixels / (camera.width * camera.height)))))
        surface = rays.depth(reduced)
        at = pixels[candidates] * [reduced.width / camera.width, reduced.height / camera.height]
        column = np.clip(at[:, 0].astype(int), 0, reduced.width - 1)
        row = np.clip(at[:, 1].astype(int), 0, reduced.height - 1)
        # Where the surface is slanted, depth may vary by several pixel footprints within one pixel of the depth map.
        slack = 2.0 * depth[candidates] / reduced.fx / np.maximum(facing[candidates], 0.2)
        candidates = candidates[depth[candidates] <= surface[row, column] + slack]
        if len(candidates) == 0:
            continue
        covered = _bilinear(view.mask, pixels[candidates]) > 127
        candidates = candidates[covered]
        color = _bilinear(view.image, pixels[candidates]) / 255.0
        score = (facing**2 * camera.fx / np.maximum(depth, 1e-12)).astype(np.float32)[candidates]
        # Insert into the ranking and shift worse views down.
        for rank in range(best):
            better = score > scores[rank, candidates]
            held_score, held_color = scores[rank, candidates], best_colors[rank, candidates]
            scores[rank, candidates] = np.where(better, score, held_score)
            best_colors[rank, candidates] = np.where(better[:, None], color, held_color)
            score = np.where(better, held_score, score)
            color = np.where(better[:, None], held_color, color)
    values = np.where(scores[:, :, None] > 0, best_colors, np.nan)
    colors = np.full((count, 3), 0.5, np.float32)
    lit = scores[0] > 0
    if lit.any():
        colors[lit] = np.nanmedian(values[:, lit], axis=0)
    if lit.any() and not lit.all():
        o3d = open3d()
        tree = o3d.core.nns.NearestNeighborSearch(o3d.core.Tensor(points[lit].astype(np.float32)))
        tree.knn_index()
        nearest = tree.knn_search(o3d.core.Tensor(points[~lit].astype(np.float32)), 1)[0].numpy()[:, 0]
        colors[~lit] = colors[lit][nearest]
    progress(len(views), len(views))
    return np.clip(colors, 0, 1)
