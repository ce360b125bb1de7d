"""Measures how far masks contradict those of the other cameras in a frame, before anything is trained."""

from v3studio.studio.errors import StudioError
from v3studio.studio.footage import Footage
from v3studio.studio.masks.mask_source import FullMaskSource, MissingMaskSource
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.meshing.agreement import LEAST_CAMERAS, PIXELS, MaskVerdict, least_views, mask_verdicts
from v3studio.studio.meshing.silhouettes import silhouettes

TOO_FEW = f"Masks of fewer than {LEAST_CAMERAS} training cameras cannot be compared with each other."
NO_CAMERAS = "Masks are compared with each other once Calibrate has run."


def why_not_judged(footage: Footage, calibrated: bool) -> str:
    """Return why the masks of a footage cannot be compared, as a sentence; "" if they can, or if there are none."""
    if isinstance(footage.mask_source, FullMaskSource | MissingMaskSource):
        return ""
    return NO_CAMERAS if not calibrated else TOO_FEW if len(footage.train_cameras) < LEAST_CAMERAS else ""


def judged(footage: Footage, frame: int) -> tuple[MaskVerdict, ...]:
    """The masks of a frame, by its number, of calibrated footage, the worst first; none if they cannot be compared."""
    names = footage.train_cameras
    if len(names) < LEAST_CAMERAS or isinstance(footage.mask_source, FullMaskSource | MissingMaskSource):
        return ()
    try:
        views = OnDemand(names, lambda name: footage.view(name, frame))
        shapes = silhouettes(views, max_pixels=PIXELS * len(names))
    except StudioError as error:
        if error.code != "hull.empty_masks":
            raise
        return tuple(MaskVerdict(name, frame, 1.0, 0.0, True) for name in names)
    return mask_verdicts(shapes, least_views(shapes), frame)
