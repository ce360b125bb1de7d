"""Images for previews and reports: rendering, and encoding as PNG or JPEG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from v3studio.studio.atomic_files import write_bytes
from v3studio.studio.errors import StudioError

if TYPE_CHECKING:
    from v3studio.studio.cameras import Camera
    from v3studio.studio.gaussians import Gaussians


def render(
    gaussians: Gaussians, camera: Camera, background: Sequence[float], device: str = "cpu", width: int | None = None
) -> np.ndarray:
    """Render Gaussians: (H, W, 3) float32, 0 to 1, at most `width` pixels wide. `background`: RGB, 0 to 1."""
    import torch

    from v3studio.studio.rasterizer import rasterize

    if width is not None and camera.width > width:
        camera = camera.scaled(width / camera.width)
    with torch.no_grad():
        color = torch.tensor(background, dtype=torch.float32, device=device)
        image = rasterize(gaussians.to(device), camera, color).image
        return image.clamp(0, 1).float().cpu().numpy()


def to_bytes(image: np.ndarray) -> np.ndarray:
    """Convert an (H, W, 3) image from float, clamped to 0 to 1, to uint8; uint8 is returned as is."""
    if image.dtype == np.uint8:
        return image
    return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def encode(image: np.ndarray, ending: str = ".png", quality: int = 92) -> bytes:
    """Encode an (H, W, 3) RGB image, uint8 or float in 0 to 1, as ".png" or ".jpg" of a quality, 0 to 100."""
    import cv2

    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if ending == ".jpg" else []
    good, data = cv2.imencode(ending, np.ascontiguousarray(to_bytes(image)[:, :, ::-1]), options)
    if not good:
        size = f"{image.shape[1]}x{image.shape[0]}"
        raise StudioError("image.encode", f"an image of {size} pixels cannot be encoded as {ending}", value=size)
    return data.tobytes()


def write_image(path: Path, image: np.ndarray) -> None:
    """Write an (H, W, 3) image as PNG, atomically."""
    write_bytes(path, encode(image))
