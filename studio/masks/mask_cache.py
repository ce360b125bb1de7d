"""Disk cache for the masks of slow matting models."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from studio.atomic_files import atomic_path


class MaskCache:
    """PNG files named by a digest of `recipe` and image, so that they never become stale; deletable at any time."""

    def __init__(self, folder: Path, recipe: str) -> None:
        self._folder, self._recipe = folder, recipe

    def get_or_make(self, image: np.ndarray, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The cached (H, W) uint8 mask of an (H, W, 3) uint8 image; if there is none, what `make` returns, which is
        then cached. Raises OSError if the file cannot be written."""
        from PIL import Image

        digest = hashlib.blake2b(f"{self._recipe}\0{image.shape}\0".encode(), digest_size=16)
        digest.update(np.ascontiguousarray(image).data)
        path = self._folder / f"mask_{digest.hexdigest()}.png"
        # a missing or truncated file is made again
        with suppress(OSError, ValueError, SyntaxError, Image.DecompressionBombError), Image.open(path) as file:
            mask = np.array(file)
            if mask.dtype == np.uint8 and mask.shape == image.shape[:2]:
                return mask
        mask = make()
        with atomic_path(path) as temporary:
            Image.fromarray(mask).save(temporary, compress_level=1)
        return mask
