"""Where the encoder of the footage took its chroma samples: found by comparing drawings with the footage."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from studio.chroma import Siting, resampled
from studio.gaussians import Gaussians
from studio.rasterizer import rasterize
from studio.training.views import TrainingView

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
