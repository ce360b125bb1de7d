"""Images of the first view of a cast: the poster of its page, and that of link previews."""

from pathlib import Path

import numpy as np
import torch

from v3studio.pipelines.reports.images import encode
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.pipelines.share.stream_to_share import preview_view
from v3studio.studio.cameras import Camera
from v3studio.studio.rasterizer import rasterize

_QUALITY = 82  # of JPEG


def cast_images(source: Path) -> tuple[bytes, bytes]:
    """Poster and preview of a cast, JPEG: its splats and its ground in the first frame. Raises StudioError as
    `CastFrames`."""
    frames = CastFrames(source)
    try:
        views = frames.camera, preview_view(frames.camera)
        poster, preview = (encode(cast_image(frames, view, 0), ".jpg", _QUALITY) for view in views)
        return poster, preview
    finally:
        frames.close()


def cast_image(frames: CastFrames, camera: Camera, frame: int) -> np.ndarray:
    """(H, W, 3) float32 RGB, 0 to 1: splats over the ground, which nobody is below."""
    behind = np.broadcast_to(np.array(frames.background, np.float32), (camera.height, camera.width, 3))
    ground = frames.ground(frame)
    if ground is not None:
        pixels, depth = ground.seen(camera)
        behind = np.where(np.isfinite(depth)[..., None], pixels / np.float32(255), behind)
    with torch.no_grad():
        drawn = rasterize(frames.gaussians(frame), camera, torch.zeros(3))
    image: np.ndarray = drawn.image.numpy() + (1 - drawn.alpha.numpy())[..., None] * behind
    return image.clip(0, 1).astype(np.float32)
