"""The metrics: one table, which the evaluation, its tables and report, `compare` and the window read."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from v3studio.studio.comparison.view_pair import ViewPair

if TYPE_CHECKING:
    from torch import Tensor


HIGHEST_PSNR = 100.0  # dB; stands for the infinite PSNR of equal images
OUTLINE = 3.0  # half the width of an outline in pixels: that far, masks of real footage are wrong where they are ragged
Distance = Callable[["Tensor", "Tensor"], float]  # LPIPS of two (H, W, 3) images


Measure = Callable[[ViewPair, Distance | None], float | None]


@dataclass(frozen=True)
class Metric:
    """A figure of image quality.

    Attributes:
        unit: behind its values; may be empty.
        measure: its value for a pair of images; None if it is not measured. None for flicker, which compares frames.
        evaluated: the evaluation of a take measures it, of trained and of decoded frames; False: only `compare` does.
        plotted: the window's timeline shows it, of trained and of decoded frames.
        narrow: tables in the terminal have a column for it.
        words: the values from which an image is good, and from which its loss is visible rather than bad; None: the
            metric has no words.
    """

    name: str
    title: str
    unit: str
    digits: int
    measure: Measure | None
    evaluated: bool = True
    plotted: bool = False
    narrow: bool = True
    words: tuple[float, float] | None = None

    def text(self, value: float | None, unit: bool = True) -> str:
        """A value with its digits and unit; "-" for None."""
        if value is None:
            return "-"
        return f"{value:.{self.digits}f}{f' {self.unit}' if unit and self.unit else ''}"


def _psnr(image: np.ndarray | None, footage: np.ndarray, where: np.ndarray | None = None) -> float | None:
    from v3studio.studio.metrics import psnr

    if image is None or (where is not None and not where.any()):
        return None
    mask = None if where is None else _tensor(where)
    return min(float(psnr(_tensor(image), _tensor(footage), mask)), HIGHEST_PSNR)


def _in_mask(pair: ViewPair, where: np.ndarray | None = None) -> float | None:
    return _psnr(pair.rendered, pair.footage, where)


def _uncut(part: Literal["picture", "fitted", "box", "performer"]) -> Measure:
    def measured(pair: ViewPair, lpips: Distance | None) -> float | None:
        uncut = pair.uncut
        if uncut is None:
            return None
        if part == "box":
            return _psnr(uncut.rendered[uncut.box], uncut.footage[uncut.box])
        if part == "fitted":
            return _psnr(uncut.fitted, uncut.footage)
        return _psnr(uncut.rendered, uncut.footage, uncut.performer if part == "performer" else None)

    return measured


def _ssim(pair: ViewPair, lpips: Distance | None) -> float:
    from v3studio.studio.metrics import ssim

    return float(ssim(_tensor(pair.rendered), _tensor(pair.footage)))


def _lpips(pair: ViewPair, lpips: Distance | None) -> float | None:
    if lpips is None:
        return None
    from v3studio.studio.perceptual import at_least

    rendered, footage = (at_least(_tensor(image), pair.background) for image in (pair.rendered, pair.footage))
    return lpips(rendered, footage)


def _tensor(image: np.ndarray) -> Any:
    import torch

    return torch.from_numpy(np.ascontiguousarray(image))


METRICS = (
    Metric("psnr", "masked PSNR", "dB", 2, lambda one, _: _in_mask(one), plotted=True, words=(31.0, 25.0)),
    Metric("psnr_interior", "masked PSNR interior", "dB", 2, lambda one, _: _in_mask(one, one.depth > OUTLINE)),
    Metric("psnr_outline", "masked PSNR outline", "dB", 2, lambda one, _: _in_mask(one, abs(one.depth) <= OUTLINE)),
    Metric("psnr_performer", "uncut PSNR performer", "dB", 2, _uncut("performer")),
    Metric("psnr_moving", "uncut PSNR box", "dB", 2, _uncut("box"), narrow=False),
    Metric("psnr_picture", "uncut PSNR picture", "dB", 2, _uncut("picture"), narrow=False),
    Metric("psnr_picture_fitted", "uncut PSNR picture after a color fit", "dB", 2, _uncut("fitted"), narrow=False),
    Metric("psnr_color_fit", "color fit", "dB", 2, lambda one, _: _psnr(one.fitted, one.footage), evaluated=False),
    Metric("ssim", "SSIM", "", 4, _ssim),
    Metric("lpips", "LPIPS", "", 4, _lpips),
)
"""Metrics of a view, in the order in which they are shown. First those of footage that the mask has cut out, in its
box, which miss what the mask misses: PSNR; of the performer more than 3 pixels from the mask's outline, where a ragged
mask does not count; up to 3 pixels from it, on both sides. Then PSNR of splats over the set against the uncut footage,
if what is behind the performer is known: where they are, by mask or by difference from the set; in the box around that;
of the whole picture, before a set of splats also after the best 3x4 color matrix, since the colors of a camera that was
not trained on are not known. In the box after the best such matrix; SSIM; LPIPS, if it is asked for.

The words for PSNR follow the scale of EvalVid (J. Klaue et al., 2003): from 31 dB "good", from 25 dB "fair", below
"poor" and "bad"."""

MAIN = METRICS[0]  # stands for quality where there is room for one: above the timeline, on the start page, in lists

UNCUT = frozenset(metric.name for metric in METRICS if metric.title.startswith("uncut"))
"""Metrics against the uncut footage, which need no mask."""

EVALUATED = tuple(metric for metric in METRICS if metric.evaluated)

FLICKER = Metric("flicker", "flicker", "levels of 255", 2, None)  # between consecutive frames; see `Residual`


def measure(pair: ViewPair, lpips: Distance | None = None, masked: bool = True) -> dict[str, float]:
    """The metrics of a pair of images that are measured, by name; `masked`: also those of footage that is cut out."""
    measures = [(metric, metric.measure) for metric in METRICS if metric.measure is not None]
    results = [(metric, call(pair, lpips)) for metric, call in measures if masked or metric.name in UNCUT]
    return {metric.name: round(value, metric.digits + 2) for metric, value in results if value is not None}
