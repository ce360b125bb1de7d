"""Images of the first view of a cast: the poster of its page, and that of link previews."""

from pathlib import Path

import numpy as np
import torch

from v3studio.pipelines.reports.images import encode
from v3studio.pipelines.share.cast_frames import CastFrames
from v3studio.pipelines.share.stream_to_share import preview_view
from v3studio.studio.cameras import Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.rasterizer import rasterize

_QUALITY = 82  # of JPEG


def cast_images(source: Path) -> tuple[bytes, bytes] | None:
    """Poster and preview of a cast, JPEG: its splats and its ground in the first frame, without models. None if it has
    models only. Raises StudioError as `CastFrames`."""
    try:
        frames = CastFrames(source)
    except StudioError as error:
        if error.code == "share.no_splats":
            return None
        raise
    try:
        poster, preview = (_image(frames, view) for view in (frames.camera, preview_view(frames.camera)))
        return poster, preview
    finally:
        frames.close()


def _image(frames: CastFrames, camera: Camera) -> bytes:
    """The first frame: splats over the ground, which nobody is below."""
    behind = np.broadcast_to(np.array(frames.background, np.float32), (camera.height, camera.width, 3))
    ground = frames.ground(0)
    if ground is not None:
        pixels, depth = ground.seen(camera)
        behind = np.where(np.isfinite(depth)[..., None], pixels / np.float32(255), behind)
    with torch.no_grad():
        drawn = rasterize(frames.gaussians(0), camera, torch.zeros(3))
    image = drawn.image.numpy() + (1 - drawn.alpha.numpy())[..., None] * behind
    return encode(image.clip(0, 1).astype(np.float32), ".jpg", _QUALITY)
