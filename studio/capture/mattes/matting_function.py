"""Mattes by any function of a picture: a matting model, or an engineer's own code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from studio.capture.mattes.filters import keep_components
from studio.capture.mattes.garbage_mattes import GarbageMattes
from studio.capture.mattes.matte_cache import MatteCache
from studio.errors import StudioError


class MattingFunction(Protocol):
    """From a picture to its matte. May be called by several threads at once."""

    def __call__(self, image: np.ndarray, /) -> np.ndarray:
        """(H, W) floats in 0..1, 1 = performer, of (H, W, 3) uint8 RGB."""
        ...


class FunctionMatteSource:
    """A `MatteSource` of a `MattingFunction`; `Footage.with_matte_source` takes it.

    Args:
        function: makes the mattes.
        name: what to call it in messages.
        files: what it is made from; a take runs again when they change.
        kept: where mattes are kept on disk; None keeps none.
        components: how many pieces of performer to keep, largest first; 0 keeps all that the function gives.
        garbage: where the performer may be; None is everywhere.
    """

    def __init__(
        self,
        function: MattingFunction,
        name: str = "The matting function",
        *,
        files: Sequence[Path] = (),
        kept: MatteCache | None = None,
        components: int = 0,
        garbage: GarbageMattes | None = None,
    ) -> None:
        self._function, self._name = function, name
        self._files = list(files)
        self._kept = kept
        self._components = components
        self._garbage = garbage

    def matte(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MatteSource`.

        Raises:
            StudioError: the function gave something else than a matte of the image's size in 0..1.
        """
        image = np.ascontiguousarray(image[:, :, :3])
        matte = self._kept.read(image) if self._kept is not None else None
        if matte is None:
            matte = self._made(camera, frame, image)
            if self._kept is not None:
                self._kept.write(image, matte)
        inside = self._garbage.inside(camera, frame, image) if self._garbage is not None else None
        if inside is not None:
            matte = matte * inside.astype(np.uint8)
        return _largest(matte, self._components) if self._components else matte

    def files(self) -> list[Path]:
        """See `MatteSource`."""
        return self._files + (self._garbage.files() if self._garbage is not None else [])

    def _made(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        values = np.asarray(self._function(image))
        where = f"{self._name}, camera '{camera}', frame {frame}:"
        if values.shape != image.shape[:2] or values.dtype.kind != "f":
            raise StudioError(
                f"{where} gave an array of {values.shape} {values.dtype}; a matte is (height, width) floats, here "
                f"{image.shape[:2]}."
            )
        if not np.isfinite(values).all():
            raise StudioError(f"{where} gave values that are no numbers; the function or its model is broken.")
        if values.min() < -0.01 or values.max() > 1.01:
            raise StudioError(
                f"{where} gave values from {values.min():.3g} to {values.max():.3g}; a matte's lie in 0 to 1."
            )
        return np.rint(255 * np.clip(values, 0.0, 1.0)).astype(np.uint8)


def _largest(matte: np.ndarray, components: int) -> np.ndarray:
    """The largest pieces of a soft matte, with the soft edge around them."""
    import cv2

    solid = matte > 127
    kept = keep_components(solid, components, 0)
    reach = max(4, round(0.005 * max(matte.shape)))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    gone = solid & (kept == 0)
    around = cv2.dilate(kept, disc) > 0
    return np.where(around & ~gone, matte, 0).astype(np.uint8)
