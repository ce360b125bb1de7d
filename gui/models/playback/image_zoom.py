"""ImageZoom: the visible part of a capture camera's image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from v3studio.gui.drawing.canvas import Canvas
from v3studio.gui.drawing.palette import GROUND
from v3studio.studio.cameras import Camera

MOST_ZOOM = 40.0

BODY_MARGIN = 0.125
"""Room on each side of the body, as a part of its size. The body is what 99 % of the points span in each direction."""

THIN_MARGIN = 0.04
"""Room on each side of the outermost points, as a part of what they span: a splat is wider than its mean."""

FARTHEST = 0.5  # points farther than this from the body, as a part of its size, are ignored: they float


@dataclass(frozen=True)
class ImageZoom:
    """A magnified part of an image: its center as fractions of width and height; zoom 1 is the whole image."""

    u: float = 0.5
    v: float = 0.5
    zoom: float = 1.0

    def scale(self, camera: Camera | Magnifier, width: int, height: int) -> float:
        """Picture pixels per image pixel, for an image of this size."""
        return min(width / camera.width, height / camera.height) * self.zoom

    def offset(self, camera: Camera | Magnifier, width: int, height: int) -> tuple[float, float]:
        """Position of the image's upper left corner in the image, pixels."""
        scale = self.scale(camera, width, height)
        return width / 2 - self.u * camera.width * scale, height / 2 - self.v * camera.height * scale

    def camera(self, camera: Camera, width: int, height: int) -> Camera:
        """The pinhole camera of the visible part."""
        scale = self.scale(camera, width, height)
        x, y = self.offset(camera, width, height)
        K = camera.K.copy()
        K[:2] *= scale
        K[0, 2] += x
        K[1, 2] += y
        return Camera(camera.name, width, height, K, camera.world_to_camera)

    def picture(self, image: np.ndarray, camera: Camera | Magnifier, width: int, height: int) -> np.ndarray:
        """(height, width, 3) uint8: the part of the camera's (H, W, 3) uint8 image, resampled, over the background."""
        scale = self.scale(camera, width, height) * camera.width / image.shape[1]
        x, y = self.offset(camera, width, height)
        if scale < 1:  # resampling alone would alias
            size = max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1)
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            scale = self.scale(camera, width, height) * camera.width / image.shape[1]
        # OpenCV's origin is the center of the first pixel; ours is its corner
        warp = np.array([[scale, 0, x + 0.5 * scale - 0.5], [0, scale, y + 0.5 * scale - 0.5]])
        pixels = cv2.warpAffine(image, warp, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        pixels = np.ascontiguousarray(pixels)
        self.mask_outside(pixels, camera)
        return pixels

    def inside(self, camera: Camera | Magnifier, width: int, height: int) -> tuple[int, int, int, int]:
        """The camera's image in an image of this size: first column and row, and those after the last, pixels."""
        scale = self.scale(camera, width, height)
        x, y = self.offset(camera, width, height)
        left, right = max(round(x), 0), min(round(x + camera.width * scale), width)
        top, bottom = max(round(y), 0), min(round(y + camera.height * scale), height)
        return left, top, right, bottom

    def mask_outside(self, pixels: np.ndarray, camera: Camera | Magnifier) -> None:
        """Fill everything outside the camera's image with the background, in place."""
        left, top, right, bottom = self.inside(camera, pixels.shape[1], pixels.shape[0])
        pixels[:top], pixels[bottom:], pixels[:, :left], pixels[:, right:] = GROUND, GROUND, GROUND, GROUND

    def zoomed(self, notches: float) -> ImageZoom:
        """This view zoomed by notches of the wheel; positive magnifies."""
        zoom = float(np.clip(self.zoom / 0.9**notches, 1.0, MOST_ZOOM))
        return ImageZoom(0.5, 0.5, 1.0) if zoom == 1.0 else ImageZoom(self.u, self.v, zoom)

    def moved(self, dx: float, dy: float, camera: Camera | Magnifier, width: int, height: int) -> ImageZoom:
        """This view moved by a drag in pixels of the image."""
        scale = self.scale(camera, width, height)
        u = float(np.clip(self.u - dx / scale / camera.width, 0.0, 1.0))
        v = float(np.clip(self.v - dy / scale / camera.height, 0.0, 1.0))
        return ImageZoom(u, v, self.zoom)

    @classmethod
    def around(cls, points: np.ndarray, camera: Camera, width: int, height: int) -> ImageZoom:
        """The part that contains points, (N, 3) world, with a margin; those far from almost all others are ignored."""
        pixels, depth = camera.project(points)
        pixels = pixels[depth > 1e-6]
        if len(pixels) == 0:
            return cls()
        low, high = np.percentile(pixels, [0.5, 99.5], axis=0)
        size = np.maximum(high - low, 1.0)
        near = (np.abs(pixels - (low + high) / 2) <= (0.5 + FARTHEST) * size).all(axis=1)
        # What is thin, such as the handle of an axe, has few points and must not be cut.
        outer = pixels[near] if near.any() else np.stack([low, high])
        thin = np.maximum(np.ptp(outer, axis=0), 1.0) * THIN_MARGIN
        low = np.minimum(low - BODY_MARGIN * size, outer.min(axis=0) - thin)
        high = np.maximum(high + BODY_MARGIN * size, outer.max(axis=0) + thin)
        size, middle = high - low, (low + high) / 2
        fit = min(width / camera.width, height / camera.height)
        zoom = float(np.clip(min(width / size[0], height / size[1]) / fit, 1.0, MOST_ZOOM))
        if zoom == 1.0:
            return cls()
        return cls(float(middle[0] / camera.width), float(middle[1] / camera.height), zoom)


class Magnifier:
    """The part of an image that is on screen, its rectangle there in pixels, and its magnification."""

    def __init__(self, size: tuple[int, int], rect: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)) -> None:
        self.width, self.height = size
        self.view, self.rect = ImageZoom(), rect

    @property
    def _room(self) -> tuple[int, int]:
        return round(self.rect[2]), round(self.rect[3])

    @property
    def scale(self) -> float:
        """Pixels of the screen per pixel of the image."""
        return self.view.scale(self, *self._room)

    @property
    def _origin(self) -> np.ndarray:
        """(2,) where the image's upper left corner is on screen."""
        return np.add(self.rect[:2], self.view.offset(self, *self._room))

    def shown(self, points: np.ndarray | Sequence[float]) -> np.ndarray:
        """(..., 2) screen positions of pixels of the image."""
        return self._origin + self.scale * np.asarray(points)

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Image pixel at a screen position."""
        left, top = self._origin
        return float(x - left) / self.scale, float(y - top) / self.scale

    def holds(self, x: float, y: float) -> bool:
        """Whether a pixel is in the rectangle."""
        left, top, width, height = self.rect
        return left <= x < left + width and top <= y < top + height

    def pan(self, dx: float, dy: float) -> None:
        self.view = self.view.moved(dx, dy, self, *self._room)

    def zoom(self, notches: float, x: float, y: float) -> None:
        """Zoom by notches of the wheel; the image point at screen position (x, y) stays fixed."""
        before = self.pixel(x, y)
        self.view = self.view.zoomed(notches)
        if self.view != ImageZoom():
            self.pan(*((x, y) - self.shown(before)))

    def draw(self, canvas: Canvas, image: np.ndarray) -> None:
        """Draw the visible part into the rectangle."""
        canvas.image(self.rect[0], self.rect[1], self.view.picture(image, self, *self._room))
