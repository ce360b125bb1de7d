"""Silhouettes as signed distance maps.

A mask is converted to a map of signed distances in pixels: positive inside the silhouette, negative outside,
zero on its outline (with subpixel accuracy where the mask has soft edges). Multiplied by depth / focal length, it is
the distance in world units between a point and the silhouette's viewing cone. A single pixel of the map also shows
whether a ball of a given radius can touch the silhouette, which coarse-to-fine carving needs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from v3studio.studio.cameras import Camera, FootageView
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import ProgressFn, no_progress


def signed_distance(mask: np.ndarray) -> np.ndarray:
    """Signed distance (H, W) float32 in pixels, positive inside, of every pixel center to the outline of a mask, (H, W)
    uint8, where it crosses one half. Without any foreground, all values are minus the image diagonal; without any
    background, plus the image diagonal."""
    inside = (mask >= 128).astype(np.uint8)
    diagonal = float(np.hypot(*mask.shape))
    if not inside.any():
        return np.full(mask.shape, -diagonal, np.float32)
    if inside.all():
        return np.full(mask.shape, diagonal, np.float32)
    # distanceTransform measures the distance to the nearest pixel center of the other class; the outline is half a
    # pixel closer.
    within = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    beyond = cv2.distanceTransform(1 - inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    distance = np.where(inside > 0, within - 0.5, 0.5 - beyond).astype(np.float32)
    # On the outline itself, the coverage of the pixel is more accurate.
    edge = np.abs(distance) < 0.75
    coverage = mask.astype(np.float32) / 255.0 - 0.5
    return np.where(edge, np.where(inside > 0, np.minimum(coverage, 0.5), np.maximum(coverage, -0.5)), distance)


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The signed distance map of a view."""

    camera: Camera  # reduced to the size of the map
    map: torch.Tensor  # (1, 1, h, w) float32: signed distance in pixels of the reduced image
    mask: np.ndarray  # (h, w) uint8, reduced
    box: np.ndarray | None  # (4,) float64 left, top, right, bottom of the foreground in reduced pixels; None: empty
    footprint: float  # focal length in full-size pixels; a pixel covers depth / footprint in world units

    def project(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Project world points (N, 3) float32 to pixels (N, 2) in the reduced image, and depths (N,)."""
        camera = self.camera
        matrix = torch.from_numpy((camera.K @ camera.world_to_camera[:3]).astype(np.float32))
        local = points @ matrix[:, :3].T + matrix[:, 3]
        depth = local[:, 2]
        return local[:, :2] / depth.clamp_min(1e-9)[:, None], depth

    def distance(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Signed distance (N,) float32 in world units, positive inside, of (N, 3) float32 world points to the
        silhouette's cone, sampled bilinearly; and (N,) bool: whether the camera has the point in its image."""
        camera = self.camera
        pixels, depth = self.project(points)
        grid = torch.stack([pixels[:, 0] * (2.0 / camera.width) - 1, pixels[:, 1] * (2.0 / camera.height) - 1], -1)
        seen = (depth > 1e-9) & (grid.abs() <= 1).all(-1)
        sampled = torch.nn.functional.grid_sample(
            self.map, grid.clamp(-2, 2)[None, None], mode="bilinear", padding_mode="border", align_corners=False
        )[0, 0, 0]
        return sampled * (depth / (0.5 * (camera.fx + camera.fy))), seen

    def touches(self, points: torch.Tensor, radius: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Conservative test of whether balls with (N, 3) float32 centers and a radius in world units may touch the
        silhouette's cone: (N,) bool: the whole ball is certainly inside the image and outside the silhouette;
        and (N,) bool: a part of the ball may be inside the image."""
        camera = self.camera
        pixels, depth = self.project(points)
        focal = max(camera.fx, camera.fy)
        # Off the optical axis, a ball projects to an ellipse that is elongated by 1 / cos of its angle; includes a
        # margin for the error of the 5x5 distance transform.
        away = (pixels - torch.tensor([camera.cx, camera.cy], dtype=torch.float32)) / focal
        stretch = (1 + (away * away).sum(-1)).sqrt()
        reach = focal * radius / (depth - radius).clamp_min(1e-9) * stretch * 1.05 + 1.5
        # Distance to the nearest side of the viewing frustum, positive inside.
        planes = self._planes()
        margin = (points @ planes[:, :3].T + planes[:, 3]).amin(-1)
        seen = (margin > -radius) & (depth > -radius)
        whole = (margin > radius) & (depth > radius)
        size = torch.tensor([camera.width, camera.height], dtype=torch.float32)
        corner = torch.minimum(pixels.clamp_min(0), size - 1)
        corner = torch.nan_to_num(corner).long()
        value = self.map[0, 0][corner[:, 1], corner[:, 0]]
        return whole & (value < -reach), seen

    def _planes(self) -> torch.Tensor:
        """(4, 4) float32: inward unit normals and offsets, in world coordinates, of the viewing frustum's sides."""
        camera = self.camera
        K = camera.K
        sides = np.stack([K[0], camera.width * K[2] - K[0], K[1], camera.height * K[2] - K[1]])
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        return torch.from_numpy((sides @ camera.world_to_camera[:3]).astype(np.float32))


def silhouettes(
    views: Sequence[FootageView], *, max_pixels: float = 60e6, progress: ProgressFn = no_progress
) -> list[Silhouette]:
    """Signed distance maps of at least two views with pinhole cameras. Each is read once, so a lazy sequence works.

    `max_pixels`: of all maps together, at 4 bytes per pixel; larger masks are downscaled. `progress` is called per view
    and may raise `Cancelled`. StudioError: `hull.too_few_cameras`, `hull.lens_distortion`, `hull.mask_size`, or
    `hull.empty_masks`: no mask has any foreground.
    """
    if len(views) < 2:
        problem = f"A visual hull needs at least two cameras, found {len(views)}"
        raise StudioError("hull.too_few_cameras", problem, value=len(views), fix="Add cameras.", expected=2)
    shapes = []
    for index, view in enumerate(views):
        shapes.append(_silhouette(view.camera, view.mask, max_pixels / len(views)))
        progress(index + 1, len(views))
    if all(shape.box is None for shape in shapes):
        problem = f"The masks of all {len(views)} cameras are empty"
        raise StudioError("hull.empty_masks", problem, fix="Check capture.masks.", setting="capture.masks")
    return shapes


def votes(shapes: list[Silhouette], points: torch.Tensor, slack: float) -> tuple[torch.Tensor, torch.Tensor]:
    """(cameras, N) bool each: whether a camera's mask holds a world point (N, 3), give or take `slack` world units, and
    whether it sees it."""
    accepted, sees = [], []
    for shape in shapes:
        distance, seen = shape.distance(points)
        accepted.append(seen & (distance > -slack))
        sees.append(seen)
    return torch.stack(accepted), torch.stack(sees)


def _silhouette(camera: Camera, mask: np.ndarray, budget: float) -> Silhouette:
    if not camera.is_pinhole:
        problem = f"Camera '{camera.name}' has lens distortion"
        fix = "Undistort its images before meshing."
        raise StudioError("hull.lens_distortion", problem, fix=fix, camera=camera.name)
    if mask.shape != (camera.height, camera.width):
        raise StudioError(
            "hull.mask_size",
            f"Camera '{camera.name}': the mask is {mask.shape[1]}x{mask.shape[0]}, but the camera "
            f"{camera.width}x{camera.height}",
            value=(mask.shape[1], mask.shape[0]),
            fix="Masks must have the size of the images.",
            camera=camera.name,
            expected=(camera.width, camera.height),
        )
    factor = min(1.0, float(np.sqrt(budget / mask.size)))
    reduced = camera
    if factor < 1.0:
        reduced = camera.scaled(factor)
        mask = cv2.resize(mask, (reduced.width, reduced.height), interpolation=cv2.INTER_AREA)
    rows, columns = np.nonzero(mask >= 128)
    box = None
    if len(rows):
        box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], np.float64)
    distance = torch.from_numpy(signed_distance(mask))[None, None]
    return Silhouette(reduced, distance, mask, box, max(camera.fx, camera.fy))
