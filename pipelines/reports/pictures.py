"""Pictures for previews and reports: drawing, and PNG or JPEG out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipelines.takes.atomic_files import atomic_path
from studio.errors import StudioError

if TYPE_CHECKING:
    from studio.cameras import Camera
    from studio.gaussians import Gaussians


def draw(
    gaussians: Gaussians, camera: Camera, background: Sequence[float], device: str = "cpu", width: int | None = None
) -> np.ndarray:
    """(H, W, 3) float32 in 0 to 1: the splats seen from `camera`, at most `width` pixels wide."""
    import torch

    from studio.rasterizer import rasterize

    if width is not None and camera.width > width:
        camera = camera.scaled(width / camera.width)
    with torch.no_grad():
        color = torch.tensor(background, dtype=torch.float32, device=device)
        image = rasterize(gaussians.to(device), camera, color).image
        return image.clamp(0, 1).float().cpu().numpy()


def to_bytes(image: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 from floats in 0 to 1 (values outside are clamped); uint8 stays as it is."""
    if image.dtype == np.uint8:
        return image
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def encode(image: np.ndarray, ending: str = ".png", quality: int = 92) -> bytes:
    """PNG or JPEG file content of an (H, W, 3) RGB image, uint8 or float."""
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if ending == ".jpg" else []
    good, data = cv2.imencode(ending, np.ascontiguousarray(to_bytes(image)[:, :, ::-1]), options)
    if not good:
        raise StudioError(f"A picture of {image.shape[1]}x{image.shape[0]} pixels could not be written as {ending}.")
    return data.tobytes()


def write_picture(path: Path, image: np.ndarray) -> None:
    """PNG, atomic."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(encode(image))
