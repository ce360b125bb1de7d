"""Measures how far masks contradict those of the other cameras in a frame, before anything is trained."""

from dataclasses import dataclass

from v3studio.studio.errors import StudioError
from v3studio.studio.footage import Footage
from v3studio.studio.masks.mask_source import FullMaskSource, MissingMaskSource
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.meshing.agreement import LEAST_CAMERAS, PIXELS, contradicting, mask_agreement
from v3studio.studio.meshing.silhouettes import silhouettes

TOO_FEW = f"Masks of fewer than {LEAST_CAMERAS} training cameras cannot be compared with each other."
NO_CAMERAS = "Masks are compared with each other once Calibrate has run."


@dataclass(frozen=True)
class MaskVerdict:
    """The mask of a camera in a frame, by its number in the footage. `lacks`, `more`: the share that it lacks of what
    the other cameras see, and the share of it that none of them sees, 0 to 1. `wrong`: it contradicts them."""

    camera: str
    frame: int
    lacks: float
    more: float
    wrong: bool

    @property
    def words(self) -> str:
        """The larger fault."""
        if self.lacks >= self.more:
            return f"{self.lacks:.0%} of the performer is missing"
        return f"{self.more:.0%} of it is no performer"


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
    agreement = mask_agreement(shapes, max(3, len(names) // 3))
    wrong = contradicting(agreement)
    verdicts = [MaskVerdict(name, frame, at.extra, at.missing, name in wrong) for name, at in agreement.items()]
    return tuple(sorted(verdicts, key=lambda verdict: (not verdict.wrong, -verdict.lacks - verdict.more)))
