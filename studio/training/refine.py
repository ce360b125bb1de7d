"""Masks that all cameras agree on: refined from the splats' own rendered alpha while they train.

The mask of one image is uncertain at outlines, in shadows and where performer and room have the same color. Splats
have to agree with all images at once, so their rendered alpha, sharpened, is the better mask, also where each single
one is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from studio.chroma import Siting, resampled
from studio.gaussians import Gaussians
from studio.rasterizer import rasterize
from studio.training.settings import TrainSettings
from studio.training.step import Stepper, part_of
from studio.training.views import TrainingView

CONTRAST = 2.0
"""Slope of `sharpened`: splats render an outline about twice as soft as a camera does."""

REFINE_EVERY = 100
"""Steps after which the masks are refined again."""

FINAL_DROPOUT = 0.1
"""Highest dropout of the last steps, if `final_iterations` is above 0."""

REFINED_ALPHA_WEIGHT = 1.0
"""Lowest weight of the alpha loss once masks may be refined, also for masks that auto found good."""

REFINE_ABOVE = 0.22
"""For auto: mean distance between the outlines of given and rendered masks, in pixels, above which they are refined.
It is 0.14 for exact masks of the sample capture and 0.33 for those from clean plates."""

REFINE_MOVED_BELOW = 0.66
"""For auto in later frames: above this distance, in pixels, the motion was not found. The given masks are then kept
until fine-tuning has brought the splats closer."""


def sharpened(alpha: Tensor) -> Tensor:
    """Alpha with twice the contrast around one half, clamped to 0 to 1; any shape."""
    return ((alpha - 0.5) * CONTRAST + 0.5).clamp(0, 1)


def drawn_mask(gaussians: Gaussians, view: TrainingView) -> Tensor:
    """(H, W) the mask of a view as the splats see it, 0 to 1, without gradient."""
    with torch.no_grad():
        return sharpened(rasterize(gaussians, view.camera).alpha)


def disagreement(drawn: Sequence[Tensor], views: Sequence[TrainingView]) -> float:
    """How much the views' masks differ from rendered ones: the sum of the absolute differences of all views, divided by
    the length of the rendered outlines, in pixels.

    About a quarter of a pixel for exact masks and a trained keyframe.

    Args:
        drawn: (H, W) per view, 0 to 1, from `drawn_mask`.
        views: with the masks to compare, in the same order.
    """
    difference = sum(float((one - view.mask).abs().sum()) for one, view in zip(drawn, views, strict=True))
    return difference / max(1.0, sum(_outline(one) for one in drawn))


def _refined(gaussians: Gaussians, view: TrainingView, mask: Tensor) -> TrainingView:
    """A view with its rendered mask, and with others in its views of details."""
    refined = view.with_mask(mask)
    refined.closer = tuple(one and one.with_mask(drawn_mask(gaussians, one)) for one in view.closer)
    return refined


def _outline(mask: Tensor) -> float:
    """Length of the outline at one half in pixels: sides between a pixel inside and one outside."""
    inside = mask > 0.5
    return float((inside[1:] != inside[:-1]).sum() + (inside[:, 1:] != inside[:, :-1]).sum())


class Refinement:
    """The last part of training a frame: masks from the splats, which are rendered repeatedly, and chroma.

    Args:
        stepper: its views are replaced.
        settings: see `TrainSettings`.
        moved: the splats come from another frame. If they are far from the masks, it is they that are wrong.

    Attributes:
        refined: whether the masks are refined; None before `begin`.
    """

    def __init__(self, stepper: Stepper, settings: TrainSettings, moved: bool = False) -> None:
        self._stepper, self._settings = stepper, settings
        self._highest = REFINE_MOVED_BELOW if moved else math.inf
        self.refined: bool | None = None
        self._splats: Gaussians | None = None
        self._siting_shift = 0.0

    def before_step(self, step: int, gaussians: Gaussians) -> None:
        """Begin or refresh if due; `step` counts from 0."""
        if step == 0:
            self.begin(gaussians.detach())
        elif step % REFINE_EVERY == 0:
            self.refresh(gaussians.detach())

    def begin(self, gaussians: Gaussians) -> None:
        """Decide whether the masks need it, refine them, and set the weights of the steps that follow."""
        self._siting_shift = chroma_shift(gaussians, self._stepper.views, self._settings.chroma_siting)
        drawn = self._drawn(gaussians)
        self.refined = self._wants(drawn)
        self._set(gaussians, drawn)

    def refresh(self, gaussians: Gaussians) -> None:
        """Draw the masks again, after `begin`. Moved splats that were too far off may have come closer."""
        drawn = self._drawn(gaussians)
        if not self.refined and self._highest < math.inf:
            self.refined = self._wants(drawn)
        if self.refined:
            self._set(gaussians, drawn)

    def _drawn(self, gaussians: Gaussians) -> list[Tensor]:
        if self._settings.refine_masks == "never":
            return []
        return [drawn_mask(gaussians, view) for view in self._stepper.views]

    def _wants(self, drawn: list[Tensor]) -> bool:
        settings = self._settings
        if settings.refine_masks != "auto":
            return settings.refine_masks == "always"
        return REFINE_ABOVE < disagreement(drawn, self._stepper.views) < self._highest

    def _set(self, gaussians: Gaussians, drawn: list[Tensor]) -> None:
        stepper, settings = self._stepper, self._settings
        if self.refined:
            stepper.views = [_refined(gaussians, view, one) for view, one in zip(stepper.views, drawn, strict=True)]
        self._splats = gaussians.clone()
        if settings.refine_masks != "never":
            stepper.alpha_weight = max(stepper.alpha_weight, REFINED_ALPHA_WEIGHT)
        stepper.chroma_shift = None if settings.chroma_siting == "none" else self._siting_shift

    def state(self) -> dict[str, Tensor]:
        """What `restore` needs: the splats that drew the masks, a hundredth of the masks' size. Empty before
        `begin`."""
        if self._splats is None:
            return {}
        decided = {"refined": torch.tensor(bool(self.refined)), "siting_shift": torch.tensor(self._siting_shift)}
        return {**decided, **{f"splats.{name}": value for name, value in self._splats.state_dict().items()}}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`, bit for bit."""
        if not state:
            return
        parts = part_of(state, "splats.")
        device = self._stepper.views[0].device
        splats = Gaussians.from_state_dict(parts).to(device)
        self.refined, self._siting_shift = bool(state["refined"]), float(state["siting_shift"])
        self._set(splats, [drawn_mask(splats, view) for view in self._stepper.views] if self.refined else [])


SITINGS: tuple[Siting, ...] = ("left", "center")


def chroma_shift(gaussians: Gaussians, views: Sequence[TrainingView], siting: str) -> float:
    """Position of the encoder's chroma samples relative to the decoder's, in pixels to the right.

    Converters often take chroma in the middle and do not say so, and decoders then assume "left". Training images
    cannot hide it: splats average over cameras on all sides, so they do not follow colors that are shifted in each
    image.

    Args:
        gaussians: trained splats.
        views: training views of the same frame.
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
            backdrop = view.backdrop(black)
            target = view.composited(black)
            image = rasterize(gaussians, view.camera, black if backdrop is None else backdrop).image
            for one in SITINGS:
                drawn = resampled(image, view.chroma, _shift_of(view, one))
                errors[one] += float((drawn - target).square().sum())
    return _shift_of(sampled[0], min(SITINGS, key=lambda one: errors[one]))


def _shift_of(view: TrainingView, siting: Siting) -> float:
    assert view.chroma is not None
    return view.chroma.shift(siting)
