"""Masks that all cameras agree on: refined from the splats' own rendered alpha while they train.

The mask of one image is uncertain at outlines, in shadows and where performer and room have the same color. Splats
have to agree with all images at once, so their rendered alpha, sharpened, is the better mask, also where each single
one is wrong.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from v3studio.studio.chroma import Siting, resampled
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.training.settings import TrainSettings
from v3studio.studio.training.step import Stepper, part_of
from v3studio.studio.training.views import TrainingView

CONTRAST = 2.0
"""Slope of `sharpened`: splats render an outline about twice as soft as a camera does."""

REFINE_EVERY = 100
"""Steps after which the masks are refined again."""

RAGGED_ABOVE = 5.0
"""Percentage of outlines that splats disagree with above which auto refines masks, see `outlines_off`.
Up to 4 for good masks, 6 and more for agreed and ragged ones (docs/measurements/masks.md)."""

_MOVED_OFF = 1.5
"""Multiple of the keyframe's percentage above which auto takes the motion of later frames for not found. Given masks
are then kept until fine-tuning has brought the splats closer."""


def sharpened(alpha: Tensor) -> Tensor:
    """Alpha with twice the contrast around one half, clamped to 0 to 1; any shape."""
    return ((alpha - 0.5) * CONTRAST + 0.5).clamp(0, 1)


def drawn_mask(gaussians: Gaussians, view: TrainingView) -> Tensor:
    """(H, W) the mask of a view as the splats see it, 0 to 1, without gradient."""
    with torch.no_grad():
        return sharpened(rasterize(gaussians, view.camera).alpha)


def outlines_off(drawn: Sequence[Tensor], views: Sequence[TrainingView]) -> float:
    """Percent of the outlines of the views' masks that are more than a pixel from those of `drawn`, (H, W) each."""
    off = length = 0
    for mask, view in zip(drawn, views, strict=True):
        outline = _outline(view.mask)
        off += int((outline & ~_widened(_outline(mask))).sum())
        length += int(outline.sum())
    return 100 * off / max(1, length)


def _refined(gaussians: Gaussians, view: TrainingView, mask: Tensor) -> TrainingView:
    """A view with its rendered mask, and with others in its views of details."""
    refined = view.with_mask(mask)
    refined.closer = tuple(closer and closer.with_mask(drawn_mask(gaussians, closer)) for closer in view.closer)
    return refined


def _outline(mask: Tensor) -> Tensor:
    """(H, W) bool: pixels of the mask beside one that is not; the image's border does not count."""
    inside = mask > 0.5
    return inside & _widened(~inside)


def _widened(where: Tensor) -> Tensor:
    """(H, W) bool: where one of the nine pixels around is set."""
    return torch.nn.functional.max_pool2d(where.float()[None, None], 3, 1, 1)[0, 0] > 0.5


class Refinement:
    """The last part of training a frame: masks from the splats, which are rendered repeatedly, and chroma.

    Args:
        stepper: its views are replaced.
        keyframe_off: `off` of the keyframe, for a later frame; None for the keyframe. If the splats of a later frame
            are much farther from the masks, it is they that are wrong.

    Attributes:
        off: percent of the masks' outlines that the splats disagree with, see `outlines_off`; None before `begin`.
        refined: whether the masks are refined; None before `begin`.
        chroma_shift: see `Stepper`.
    """

    def __init__(self, stepper: Stepper, settings: TrainSettings, keyframe_off: float | None = None) -> None:
        self._stepper, self._settings, self._keyframe_off = stepper, settings, keyframe_off
        self.off: float | None = None
        self.refined: bool | None = None
        self._splats: Gaussians | None = None
        self.chroma_shift: float | None = None

    def before_step(self, step: int, gaussians: Gaussians) -> None:
        """Begin or refresh if due; `step` counts from 0."""
        if step == 0:
            self.begin(gaussians.detach())
        elif step % REFINE_EVERY == 0:
            self.refresh(gaussians.detach())

    def begin(self, gaussians: Gaussians) -> None:
        """Decide whether the masks need it, and refine them and how colors are compared."""
        drawn = []
        if self._keyframe_off is None or self._wanted:
            drawn = self._drawn(gaussians)
            self._decide(drawn)
        siting = self._settings.chroma_siting
        if siting in SITINGS or (siting == "auto" and self._ragged):
            self.chroma_shift = chroma_shift(gaussians, self._stepper.views, siting)
        self._set(gaussians, drawn)

    def refresh(self, gaussians: Gaussians) -> None:
        """Render the masks again, after `begin`. Moved splats that were too far off may have come closer."""
        if not self._wanted:
            return
        drawn = self._drawn(gaussians)
        if not self.refined:
            self._decide(drawn)
        if self.refined:
            self._set(gaussians, drawn)

    @property
    def _ragged(self) -> bool:
        """Tell whether the keyframe's splats disagree with its masks."""
        off = self.off if self._keyframe_off is None else self._keyframe_off
        return off is not None and off > RAGGED_ABOVE

    @property
    def _wanted(self) -> bool:
        wanted = self._settings.refine_masks
        return wanted == "always" or (wanted == "auto" and self._ragged)

    def _drawn(self, gaussians: Gaussians) -> list[Tensor]:
        return [drawn_mask(gaussians, view) for view in self._stepper.views]

    def _decide(self, drawn: list[Tensor]) -> None:
        self.off = outlines_off(drawn, self._stepper.views)
        improved = self._keyframe_off is None or self.off < _MOVED_OFF * self._keyframe_off
        self.refined = self._wanted and (improved or self._settings.refine_masks == "always")

    def _set(self, gaussians: Gaussians, drawn: list[Tensor]) -> None:
        stepper = self._stepper
        if self.refined:
            stepper.views = [_refined(gaussians, view, mask) for view, mask in zip(stepper.views, drawn, strict=True)]
        self._splats = gaussians.clone()
        stepper.chroma_shift = self.chroma_shift

    def state(self) -> dict[str, Tensor]:
        """Tensors for `restore`: the splats that drew the masks, a hundredth of the masks' size. Empty before
        `begin`."""
        if self._splats is None:
            return {}
        shift = math.nan if self.chroma_shift is None else self.chroma_shift
        decided = {"refined": bool(self.refined), "off": self.off, "chroma_shift": shift}
        return {
            **{name: torch.tensor(value, dtype=torch.float64) for name, value in decided.items()},
            **{f"splats.{name}": value for name, value in self._splats.state_dict().items()},
        }

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`, bit for bit."""
        if not state:
            return
        splats = Gaussians.from_state_dict(part_of(state, "splats.")).to(self._stepper.views[0].device)
        self.refined, self.off, shift = bool(state["refined"]), float(state["off"]), float(state["chroma_shift"])
        self.chroma_shift = None if math.isnan(shift) else shift
        self._set(splats, self._drawn(splats) if self.refined else [])


SITINGS: tuple[Siting, ...] = ("left", "center")


def chroma_shift(gaussians: Gaussians, views: Sequence[TrainingView], siting: str) -> float:
    """Position of the encoder's chroma samples relative to the decoder's, in pixels to the right.

    Converters often take chroma in the middle and do not say so, and decoders then assume "left". Training images
    cannot hide it: splats average over cameras on all sides, so they do not follow colors that are shifted in each
    image.

    Args:
        siting: "left" or "center"; "auto": the one with which drawings come closer to the footage; "none": 0.
    """
    sampled = [view for view in views if view.chroma is not None and view.chroma.siting is not None]
    if siting == "none" or not sampled:
        return 0.0
    if siting in SITINGS:
        return _shift_of(sampled[0], siting)
    errors = dict.fromkeys(SITINGS, 0.0)
    with torch.no_grad():
        for view in sampled:
            assert view.chroma is not None
            black = torch.zeros(3, device=view.device)
            target, behind = view.over(black)
            image = rasterize(gaussians, view.camera, behind).image
            for candidate in SITINGS:
                drawn = resampled(image, view.chroma, _shift_of(view, candidate))
                errors[candidate] += float((drawn - target).square().sum())
    return _shift_of(sampled[0], min(SITINGS, key=lambda siting: errors[siting]))


def _shift_of(view: TrainingView, siting: Siting) -> float:
    assert view.chroma is not None
    return view.chroma.shift(siting)
