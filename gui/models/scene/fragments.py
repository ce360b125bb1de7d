"""Lines, points and images as pixels with depths, for `gui.models.scene.compose`."""

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from v3studio.gui.models.scene.contents import Lines
from v3studio.studio.cameras import Camera

NEAR = 1e-3  # least depth that is drawn, world units


FRAGMENT = np.dtype([("pixel", np.int64), ("depth", float), ("cover", float), ("color", np.uint8, 3)], align=True)
"""A cover of a pixel, row * width + column, at a depth in world units. Fragments are in any order; pixels repeat."""


def fragments(pixel: np.ndarray, depth: np.ndarray, cover: np.ndarray | float, color: np.ndarray) -> np.ndarray:
    """(F,) `FRAGMENT`."""
    rows = np.empty(len(pixel), FRAGMENT)
    rows["pixel"], rows["depth"], rows["cover"], rows["color"] = pixel, depth, cover, color
    return rows


def point_fragments(camera: Camera, points: np.ndarray, colors: np.ndarray, radius: int) -> np.ndarray:
    """(F,) `FRAGMENT`: points (N, 3), colors (N, 3) uint8, 2 * radius - 1 pixels wide; round if more than 3. A pixel
    has the nearest point only, which hides the others: there may be very many."""
    pixels, depth = camera.project(points)
    good = np.flatnonzero((depth > NEAR) & (np.abs(pixels) < 1e6).all(axis=1))
    good = good[np.argsort(-depth[good], kind="stable")]  # far ones first
    place = np.floor(pixels[good]).astype(np.int64)
    nearest = np.full(camera.width * camera.height, -1)
    steps = np.array(list(product(range(1 - radius, radius), repeat=2)))
    steps = steps[(steps**2).sum(axis=1) <= (radius - 0.5) ** 2]
    x, y = np.moveaxis(place[:, None] + steps, 2, 0)
    inside = (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    nearest[(y * camera.width + x)[inside]] = np.repeat(good[:, None], len(steps), axis=1)[inside]  # the last one stays
    pixel = np.flatnonzero(nearest >= 0)
    which = nearest[pixel]
    return fragments(pixel, depth[which], 1.0, colors[which])


def line_fragments(camera: Camera, lines: Lines) -> np.ndarray:
    """(F,) `FRAGMENT`: antialiased lines, seen by a pinhole camera."""
    ends = lines.ends @ camera.rotation.T + camera.translation
    ends, kept = _in_front(ends)
    colors = lines.colors[kept]
    focal, middle = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    pixels = ends[..., :2] / ends[..., 2:] * focal + middle
    inverse = 1 / ends[..., 2]  # changes linearly along a line in the image
    steep = np.abs(np.subtract(pixels[:, 1, 1], pixels[:, 0, 1])) > np.abs(pixels[:, 1, 0] - pixels[:, 0, 0])
    spans = []
    for is_steep in (False, True):
        which = steep == is_steep
        spans.append(_spans(camera, pixels[which], inverse[which], colors[which], lines.width, is_steep))
    return np.concatenate(spans)


def _in_front(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines (M, 2, 3) cut at the near plane, and which of them are left."""
    depth = ends[..., 2]
    kept = np.asarray((depth > NEAR).any(axis=1))
    ends, depth = ends[kept].copy(), depth[kept]
    for end, other in ((0, 1), (1, 0)):
        behind = depth[:, end] <= NEAR
        share = (2 * NEAR - depth[behind, end]) / (depth[behind, other] - depth[behind, end])
        ends[behind, end] += share[:, None] * (ends[behind, other] - ends[behind, end])
    return ends, kept


def _spans(
    camera: Camera, pixels: np.ndarray, inverse: np.ndarray, colors: np.ndarray, width: float, steep: bool
) -> np.ndarray:
    """The pixels of lines that go along x, or along y (`steep`)."""
    along, across = (1, 0) if steep else (0, 1)
    size = (camera.width, camera.height)
    backwards = pixels[:, 0, along] > pixels[:, 1, along]
    pixels[backwards], inverse[backwards] = pixels[backwards, ::-1], inverse[backwards, ::-1]
    first = np.ceil(np.clip(pixels[:, 0, along] - 0.5, 0, size[along])).astype(np.int64)
    last = np.floor(np.clip(pixels[:, 1, along] - 0.5, -1, size[along] - 1)).astype(np.int64)
    low, high = pixels[..., across].min(axis=1), pixels[..., across].max(axis=1)
    seen = (high > -width - 1) & (low < size[across] + width + 1)  # else it has no pixels in the image
    count = np.where(seen, np.maximum(last - first + 1, 0), 0)
    line = np.repeat(np.arange(len(pixels)), count)
    at = first[line] + np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    length = np.maximum(pixels[:, 1, along] - pixels[:, 0, along], 1e-9)
    slope = (pixels[:, 1, across] - pixels[:, 0, across]) / length
    share = (at + 0.5 - pixels[line, 0, along]) / length[line]
    minor = pixels[line, 0, across] + slope[line] * (at + 0.5 - pixels[line, 0, along])
    depth = 1 / (inverse[line, 0] + share * (inverse[line, 1] - inverse[line, 0]))
    tilt = 1 / np.sqrt(1 + slope**2)
    reach = int(np.ceil(width))
    parts = []
    for step in range(-reach, reach + 1):
        side = np.floor(minor).astype(np.int64) + step
        cover = np.clip(0.5 * width + 0.5 - np.abs(side + 0.5 - minor) * tilt[line], 0, 1)
        good = (cover > 0) & (side >= 0) & (side < size[across])
        row, column = (at, side) if steep else (side, at)
        parts.append(fragments((row * camera.width + column)[good], depth[good], cover[good], colors[line[good]]))
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Patch:
    """A surface in a rectangle: where it is, (h, w), its pixels (h, w, 3) uint8, and depths in world units."""

    rows: slice
    columns: slice
    where: np.ndarray
    pixels: np.ndarray
    depth: np.ndarray


def image_on_quad(camera: Camera, corners: np.ndarray, image: np.ndarray) -> Patch | None:
    """An image (h, w, 3) on four world points in a plane, clockwise from the upper left; None if it is not seen."""
    pixels, depth = camera.project(corners)
    if (depth <= NEAR).any() or np.abs(pixels).max() > 20 * max(camera.width, camera.height):
        return None
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int), (camera.width, camera.height))
    if right <= left or bottom <= top:
        return None
    height, width = image.shape[:2]
    size = (int(right - left), int(bottom - top))
    flat = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    warp = cv2.getPerspectiveTransform(flat, (pixels - (left, top)).astype(np.float32))
    where = cv2.warpPerspective(np.full((height, width), 255, np.uint8), warp, size) > 127
    warped = cv2.warpPerspective(image, warp, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # the inverse of the depth is an affine function of the pixel on a plane
    plane = np.linalg.lstsq(np.column_stack([pixels, np.ones(4)]), 1 / depth, rcond=None)[0]
    y, x = np.mgrid[top:bottom, left:right] + 0.5
    inverse = plane[0] * x + plane[1] * y + plane[2]
    depths = (1 / np.maximum(inverse, 1e-9)).astype(np.float32)
    return Patch(slice(top, bottom), slice(left, right), where, warped, depths)
