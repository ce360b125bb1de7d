"""One photometric training step, shared by the keyframe, motion and fine-tuning stages."""

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
"""`snapshot(iteration, gaussians)`: called regularly with detached splats, for previews."""


@dataclass
class Step:
    """Result of one step.

    Attributes:
        loss: scalar, equation 7, plus the alpha loss if enabled; backward() has not been called yet.
        target: (H, W, 3) image with which the render was compared.
        render: the render; `radii` has an entry for every splat, 0 for dropped ones.
        view: the training view.
    """

    loss: Tensor
    target: Tensor
    render: Render
    view: TrainingView

    @property
    def psnr(self) -> float:
        """PSNR of the crop of this step in dB, over the training background."""
        return float(psnr(self.render.image.detach(), self.target))


class Stepper:
    """Renders random views over random backgrounds, both drawn by the generator, and computes equation 7."""

    def __init__(self, views: Sequence[TrainingView], settings: TrainSettings, generator: torch.Generator) -> None:
        self._settings = settings
        self._generator = generator
        self._views = Shuffled(views, generator)
        self._backgrounds = backgrounds(settings.background, generator, views[0].device)

    def __call__(self, gaussians: Gaussians, screen_offsets: Tensor | None = None, dropout: bool = False) -> Step:
        """Render the next view and compare it with the footage; with `dropout`, a random subset of the splats."""
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
        if kept is not None:  # dropped splats were not drawn
            render = replace(render, radii=render.radii.new_zeros(count).index_copy(0, kept, render.radii))
        loss = photometric_loss(render.image, target, self._settings.dssim_weight)
        if self._settings.alpha_weight:
            loss = loss + self._settings.alpha_weight * (render.alpha - view.matte).abs().mean()
        return Step(loss, target, render, view)

    def state(self) -> dict[str, Tensor]:
        """Position in the sequence of views. The caller stores the state of the generator."""
        return {"views": self._views.state()}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`."""
        self._views.restore(state["views"])


def dropped(gaussians: Gaussians, share: float, generator: torch.Generator) -> tuple[Gaussians, Tensor]:
    """Drop a random fraction of the splats; the opacities of the others are divided by 1 - `share` to compensate.

    With few cameras, splats overfit jointly: one hides the error of another in the training views. Dropping a random
    subset in each step reduces this and improves held-out views (DropGaussian, Park et al. 2025, equation 6).

    Args:
        gaussians: N splats.
        share: fraction to drop, above 0 and below 1.
        generator: selects the dropped splats.

    Returns:
        The M remaining splats, and their (M,) indices.
    """
    kept = (torch.rand(len(gaussians), generator=generator) >= share).nonzero()[:, 0].to(gaussians.device)
    left = gaussians[kept]
    opacities = (left.opacities / (1 - share)).clamp(1e-6, _MAX_OPACITY)
    return Gaussians(left.means, left.quats, left.log_scales, torch.logit(opacities), left.sh), kept


def check_finite(loss: Tensor, phase: str) -> None:
    """Check that training has not diverged; `phase` ("keyframe", "motion" or "fine-tuning") is for the error.

    Raises:
        StudioError: `training.diverged`: the loss is NaN or infinite.
    """
    if not torch.isfinite(loss):
        raise StudioError(
            "training.diverged",
            f"{phase} training diverged: the loss is {float(loss)}",
            value=float(loss),
            fix="Lower the learning rates (train.rates), or check the images and mattes",
            phase=phase,
        )
