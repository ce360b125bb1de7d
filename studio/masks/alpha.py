"""Masks from the alpha channel of the images."""

import numpy as np

from v3studio.studio.errors import StudioError
from v3studio.studio.masks.mask_source import MaskInputs, MaskSource, evenly_spaced

_SAMPLED_CAMERAS = 4


class AlphaMaskSource(MaskSource):
    """A `MaskSource` that uses the alpha channel of the images."""

    def mask(self, camera: str, frame: int, image: np.ndarray) -> np.ndarray:
        """The mask as `MaskSource.mask` describes it. Raises StudioError `mask.alpha_missing`."""
        if image.shape[2] != 4:
            problem = f"Frame {frame} of camera '{camera}' has no alpha channel"
            fix = "Choose another source of masks in capture.masks."
            raise StudioError(
                "mask.alpha_missing", problem, fix=fix, camera=camera, frame=frame, setting="capture.masks"
            )
        return np.ascontiguousarray(image[:, :, 3])


def open_alpha(inputs: MaskInputs, required: bool) -> tuple[MaskSource, str] | None:
    """Open masks from the images, for `SOURCES`. Raises StudioError `mask.alpha_missing`."""
    bare = next((name for name, source in inputs.sources.items() if not source.has_alpha), None)
    opaque = bare is None and _is_opaque(inputs)
    if bare is None and (required or not opaque):
        warning = ". Warning: it is opaque in the images that were looked at" if opaque else ""
        return AlphaMaskSource(), f"alpha channel of the images{warning}"
    if not required:
        return None
    problem = f"capture.masks is alpha, but the images of camera '{bare}' have no alpha channel"
    fix = "Choose another source of masks in capture.masks."
    raise StudioError("mask.alpha_missing", problem, fix=fix, camera=bare, setting="capture.masks")


def _is_opaque(inputs: MaskInputs) -> bool:
    """Return whether nothing is transparent in the first image of some cameras: many programs write such a channel."""
    some = (inputs.sources[name] for name in evenly_spaced(inputs.names, _SAMPLED_CAMERAS))
    return all(source.read(source.frames[0])[:, :, 3].min() == 255 for source in some)
