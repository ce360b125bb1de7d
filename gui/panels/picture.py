"""Handing numpy pictures to Open3D's image widget."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from open3d.visualization import gui


def as_image(pixels: np.ndarray) -> o3d.geometry.Image:
    """An Open3D image of (H, W, 3) uint8 RGB. Three channels: with four the widget blends with what lies below."""
    return o3d.geometry.Image(np.ascontiguousarray(pixels))


def plain(width: int, height: int, colour: tuple[int, int, int], mark: int) -> np.ndarray:
    """(height, width, 3) uint8 of one colour. Open3D lets images of equal content share a texture, so that updating one
    would change the other: `mark` makes the first pixel differ by a shade."""
    pixels = np.empty((height, width, 3), np.uint8)
    pixels[:] = colour
    pixels[0, 0, 2] = (colour[2] + mark) % 256
    return pixels


def image_widget(pixels: np.ndarray) -> gui.ImageWidget:
    """A widget that shows `pixels` stretched to its frame (equal sizes give pixel-exact pictures)."""
    ui_image = gui.UIImage(as_image(pixels))
    ui_image.scaling = gui.UIImage.Scaling.ANY
    widget = gui.ImageWidget()
    widget.ui_image = ui_image
    return widget
