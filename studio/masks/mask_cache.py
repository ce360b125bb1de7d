"""Disk cache for the masks of slow matting models."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from v3studio.studio.atomic_files import atomic_path


def cached_mask(folder: Path | None, recipe: str, image: np.ndarray, make: Callable[[], np.ndarray]) -> np.ndarray:
    """The (H, W) uint8 mask of an (H, W, 3) uint8 image: what `make` returns, kept in a PNG file below `folder`, if
    there is one. Files are named by a digest of `recipe` and image, so that they never become stale; they may be
    deleted at any time. Raises OSError if a file cannot be written."""
    from PIL import Image

    if folder is None:
        return make()
    digest = hashlib.blake2b(f"{recipe}\0{image.shape}\0".encode(), digest_size=16)
    digest.update(np.ascontiguousarray(image).data)
    path = folder / "masks" / f"mask_{digest.hexdigest()}.png"
    # a missing or truncated file is made again
    with suppress(OSError, ValueError, SyntaxError, Image.DecompressionBombError), Image.open(path) as file:
        mask = np.array(file)
        if mask.dtype == np.uint8 and mask.shape == image.shape[:2]:
            return mask
    mask = make()
    with atomic_path(path) as temporary:
        Image.fromarray(mask).save(temporary, compress_level=1)
    return mask
