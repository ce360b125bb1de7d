"""Disk cache for the masks of slow matting models."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from studio.atomic_files import atomic_path


class MaskCache:
    """PNG files named by a digest of `recipe` and image, so that they never become stale; deletable at any time."""

    def __init__(self, folder: Path, recipe: str) -> None:
        self._folder, self._recipe = folder, recipe

    def _path(self, image: np.ndarray) -> Path:
        digest = hashlib.blake2b(f"{self._recipe}\0{image.shape}\0".encode(), digest_size=16)
        digest.update(np.ascontiguousarray(image).data)
        return self._folder / f"mask_{digest.hexdigest()}.png"

    def get_or_make(self, image: np.ndarray, make: Callable[[], np.ndarray]) -> np.ndarray:
        """The cached (H, W) uint8 mask of an (H, W, 3) uint8 image; if there is none, what `make` returns, which is
        then cached. Raises OSError if the file cannot be written."""
        mask = self._read(image)
        if mask is None:
            mask = make()
            self._write(image, mask)
        return mask

    def _read(self, image: np.ndarray) -> np.ndarray | None:
        from PIL import Image

        try:
            with Image.open(self._path(image)) as file:
                mask = np.array(file)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # missing or truncated: recomputed
            return None
        return mask if mask.dtype == np.uint8 and mask.shape == image.shape[:2] else None

    def _write(self, image: np.ndarray, mask: np.ndarray) -> None:
        from PIL import Image

        with atomic_path(self._path(image)) as temporary:
            Image.fromarray(mask).save(temporary, compress_level=1)
