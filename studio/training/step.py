"""One photometric step, shared by keyframe, motion and fine-tuning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.metrics import psnr
from studio.rasterizer import Render, rasterize
from studio.training.photometric import photometric_loss
from studio.training.settings import TrainSettings
from studio.training.views import Shuffled, TrainingView, backgrounds

_MAX_OPACITY = 0.995

SnapshotFn = Callable[[int, Gaussians], None]
"""`snapshot(iteration, gaussians)`: called now and then with detached splats, for previews."""


@dataclass
class Step:
    """What one step drew.

    Attributes:
        loss: scalar, equation 7 (and the alpha term where it is switched on); not yet propagated.
        target: (H, W, 3) what the picture was compared with.
        render: the picture; `radii` are those of all splats, 0 for the ones that dropout left out.
        view: where it was taken.
    """

    loss: Tensor
    target: Tensor
    render: Render
    view: TrainingView

    @property
    def psnr(self) -> float:
        """Of this step's crop, dB, against the training background."""
        return float(psnr(self.render.image.detach(), self.target))


class Stepper:
    """Draws views and backgrounds in a random order fixed by the generator and computes equation 7."""

    def __init__(self, views: Sequence[TrainingView], settings: TrainSettings, generator: torch.Generator) -> None:
        self._settings = settings
        self._generator = generator
        self._views = Shuffled(views, generator)
        self._backgrounds = backgrounds(settings.background, generator, views[0].device)

    def __call__(self, gaussians: Gaussians, screen_offsets: Tensor | None = None, dropout: bool = False) -> Step:
        """Draw the next view of `gaussians` and compare; with `dropout`, of a random share of them."""
        view, background = next(self._views), next(self._backgrounds)
        count, kept = len(gaussians), None
        if dropout and self._settings.dropout:
            gaussians, kept = dropped(gaussians, self._settings.dropout, self._generator)
            screen_offsets = None if screen_offsets is None else screen_offsets[kept]
        target = view.composited(background)
        backdrop = view.backdrop(background)
        if backdrop is None:
            render = rasterize(gaussians, view.camera, background, screen_offsets=screen_offsets)
        else:
            render = rasterize(gaussians, view.camera, screen_offsets=screen_offsets)
            render = replace(render, image=torch.addcmul(render.image, 1 - render.alpha[..., None], backdrop))
        if kept is not None:  # a splat that was left out was not drawn
            render = replace(render, radii=render.radii.new_zeros(count).index_copy(0, kept, render.radii))
        loss = photometric_loss(render.image, target, self._settings.dssim_weight)
        if self._settings.alpha_weight:
            loss = loss + self._settings.alpha_weight * (render.alpha - view.matte).abs().mean()
        return Step(loss, target, render, view)

    def state(self) -> dict[str, Tensor]:
        """Where it stands among the views; the generator is its owner's."""
        return {"views": self._views.state()}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Go on from `state`."""
        self._views.restore(state["views"])


def dropped(gaussians: Gaussians, share: float, generator: torch.Generator) -> tuple[Gaussians, Tensor]:
    """A random 1 - `share` of the splats, their opacities divided by 1 - `share` so that the picture stays as dense.

    With few cameras splats learn to be right together only in the training views: one hides the other's error. Leaving
    a random share of them out at each step makes each right by itself, which shows in views that were never trained on
    (DropGaussian, Park et al. 2025, equation 6).

    Args:
        gaussians: N splats.
        share: above 0 and below 1.
        generator: draws which ones.

    Returns:
        The M splats that are left, and their (M,) indices.
    """
    kept = (torch.rand(len(gaussians), generator=generator) >= share).nonzero()[:, 0].to(gaussians.device)
    left = gaussians[kept]
    opacities = (left.opacities / (1 - share)).clamp(1e-6, _MAX_OPACITY)
    return Gaussians(left.means, left.quats, left.log_scales, torch.logit(opacities), left.sh), kept


def check_finite(loss: Tensor, what: str) -> None:
    """Raises StudioError when training has diverged."""
    if not torch.isfinite(loss):
        raise StudioError(
            f"{what}: the loss is no longer a finite number; lower the learning rates or check the images."
        )
