"""Masks from the alpha channel of the images."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from studio.errors import StudioError
from studio.masks.mask_source import MaskInputs, MaskSource


class AlphaMaskSource:
    """A `MaskSource` that uses the alpha channel of the images."""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """See `MaskSource`. Raises StudioError `mask.alpha_missing`."""
        if image.shape[2] != 4:
            raise StudioError(
                "mask.alpha_missing",
                f"Frame {frame} of camera '{camera}' has no alpha channel",
                fix="Choose another source of masks in capture.masks.",
                camera=camera,
                frame=frame,
                setting="capture.masks",
            )
        return np.ascontiguousarray(image[:, :, 3])

    def files(self) -> list[Path]:
        """See `MaskSource`."""
        return []


def open_alpha(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Masks from the images: see `studio.masks.sources`. Raises StudioError `mask.alpha_missing`."""
    bare = next((name for name, source in inputs.sources.items() if not source.has_alpha), None)
    if bare is None:
        return AlphaMaskSource(), "alpha channel of the images"
    if not required:
        return None
    raise StudioError(
        "mask.alpha_missing",
        f"capture.masks is alpha, but the images of camera '{bare}' have no alpha channel",
        fix="Choose another source of masks in capture.masks.",
        camera=bare,
        setting="capture.masks",
    )
