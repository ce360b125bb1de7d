"""The take's edits in words, and applied to what training and evaluation see."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pipelines.stages.params import Params
from pipelines.takes.edit_params import PREFIX, edit_params
from studio.edits.edit_list import EditList

if TYPE_CHECKING:
    from studio.capture import FootageView
    from studio.edits import CropBox

WORDS = {
    "trim": "the trim",
    "crop": "the crop box",
    "ground": "the ground plane",
    "floaters": "the limits of floaters",
    "regions": "the removed regions",
    "world": "the placement of the world",
    "details": "the marked details",
}
"""What the edits are called, by their name."""


def trained_edits(edits: EditList) -> Params:
    """What of the edits training depends on: the crop box, if it is to limit training."""
    return edit_params(edits, "crop") if edits.crop is not None and edits.crop.training else {}


def details_at(edits: EditList, frame: int) -> list[tuple[tuple[float, float, float], float, float]]:
    """Center, radius and weight of each marked detail in a frame, counted from 0 in the take."""
    return [(_rounded(one.at(frame)), one.radius, one.weight) for one in edits.details]


def _rounded(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 6) for value in point)
    return x, y, z


def change_words(name: str, before: object, now: object) -> str:
    """What happened to an edit, as a reason for a stale result; `name`: of the parameter."""
    what = WORDS.get(name.removeprefix(PREFIX), name)
    verb = "set" if before is None else "removed" if now is None else "changed"
    return f"{what} {'were' if what.endswith('s') else 'was'} {verb}"


def within_box(view: FootageView, box: CropBox | None) -> FootageView:
    """A view in which the mask ends where the camera does not see the box; None: the view as it is."""
    from studio.edits import silhouette

    if box is None:
        return view
    return replace(view, mask=np.where(silhouette(view.camera, box), view.mask, 0).astype(view.mask.dtype))
