"""One photometric training step, shared by the keyframe, motion and fine-tuning stages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import torch
from torch import Tensor

from v3studio.studio.chroma import resampled
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.metrics import psnr
from v3studio.studio.rasterizer import Render, rasterize, rasterize_views
from v3studio.studio.training.details import detail_loss
from v3studio.studio.training.dropout import drop_splats
from v3studio.studio.training.noise import draw_seed
from v3studio.studio.training.photometric import photometric_loss
from v3studio.studio.training.settings import TrainSettings
from v3studio.studio.training.views import TrainingView, backgrounds

SNAPSHOT_EVERY = 500  # steps from one snapshot to the next
FIGURES_EVERY = 20  # steps from one report of loss and PSNR to the next
Checkpoint = dict[str, Tensor]  # the complete state of a training, by name; can be stored as safetensors
CheckpointFn = Callable[[int, Checkpoint], None]
"""`checkpoint(step, state)`: called regularly. The next step modifies the tensors, so write or copy them."""

SnapshotFn = Callable[[int, Gaussians], None]
"""`snapshot(iteration, gaussians)`: called regularly with detached splats, for previews."""


@dataclass
class Step:
    """Result of one step.

    Attributes:
        loss: scalar, equation 7, plus what weights of details add, and the alpha loss if enabled; backward() has not
            been called yet.
        target: (H, W, 3) image with which the render was compared.
        image: (H, W, 3) what was compared: the render in the colors of the camera.
    """

    loss: Tensor
    target: Tensor
    view: TrainingView
    image: Tensor

    def figures(self, number: int, phase: str, splats: int) -> dict[str, float]:
        """`loss`, `psnr` (dB, over the training background) and `splats` every `FIGURES_EVERY` steps, else nothing."""
        if number % FIGURES_EVERY:
            return {}
        if not torch.isfinite(self.loss):
            problem = f"{phase} training diverged: the loss is {float(self.loss)}"
            fix = "Lower the learning rates (train.rates), or check the images and masks"
            raise StudioError("training.diverged", problem, value=float(self.loss), fix=fix, phase=phase)
        own_psnr = float(psnr(self.image.detach(), self.target))
        return {"loss": float(self.loss.detach()), "psnr": own_psnr, "splats": splats}


class Stepper:
    """Renders the views in a random order, new in each epoch, over random backgrounds, both drawn by the generator, and
    computes equation 7.

    Attributes:
        views: the training views; may be replaced by as many others.
        chroma_shift: drawings of views with subsampled chroma go through the same subsampling before they are compared;
            this is the encoder's shift, see `studio.chroma.resampled`. None: they do not.
        moved: where a view's camera sees the splats: moved ones, and their (N, 2) offsets in the image. None: where
            they are. Not for views with `closer` ones.
    """

    def __init__(self, views: Sequence[TrainingView], settings: TrainSettings, generator: torch.Generator) -> None:
        if not views:
            fix = "Remove at least one camera from capture.held_out"
            raise StudioError("training.no_views", "there are no training views", fix=fix, setting="capture.held_out")
        self.views, self._settings, self.generator = views, settings, generator
        self._left: list[int] = []  # indices of the views of this epoch that have not been rendered, in order
        self._backgrounds = backgrounds(settings.background, generator, views[0].device)
        self.chroma_shift: float | None = None
        self.moved: Callable[[Gaussians, TrainingView], tuple[Gaussians, Tensor]] | None = None

    def _next(self) -> tuple[TrainingView, Tensor]:
        if not self._left:
            self._left = torch.randperm(len(self.views), generator=self.generator).tolist()
        return self.views[self._left.pop(0)], next(self._backgrounds)

    def __call__(self, gaussians: Gaussians, dropout: bool = False) -> Step:
        """Render the next view and compare it with the footage; with `dropout`, a random subset of the splats."""
        seen = self._next()
        if dropout and self._settings.dropout:
            logits = drop_splats(gaussians.logit_opacities, self._settings.dropout, draw_seed(self.generator))
            gaussians = replace(gaussians, logit_opacities=logits)
        screen_offsets = None
        if self.moved is not None:
            gaussians, screen_offsets = self.moved(gaussians, seen[0])
        return self._steps(gaussians, [seen], screen_offsets)[0]

    def several(self, gaussians: Gaussians, count: int) -> list[Step]:
        """Take `count` steps with these splats, which are rendered in one call of the rasterizer."""
        return self._steps(gaussians, [self._next() for _ in range(count)])

    def _steps(
        self, gaussians: Gaussians, seen: list[tuple[TrainingView, Tensor]], screen_offsets: Tensor | None = None
    ) -> list[Step]:
        over = [view.over(background) for view, background in seen]
        cameras, behind = [view.camera for view, _ in seen], [behind for _, behind in over]
        renders = rasterize_views(gaussians, cameras, behind, screen_offsets=screen_offsets)
        drawn = zip(seen, over, renders, strict=True)
        return [self._step(gaussians, *view, *images, render) for view, images, render in drawn]

    def _step(
        self,
        gaussians: Gaussians,
        view: TrainingView,
        background: Tensor,
        target: Tensor,
        behind: Tensor,
        render: Render,
    ) -> Step:
        """Compare a render with the view; `target`, `behind`: what it has `over` the background."""
        image, target = self._compared(render, view, target, behind)
        loss = photometric_loss(image, target, self._settings.dssim_weight)
        for box, closer in zip_longest(view.detail_boxes, view.closer):
            parts: tuple[Tensor, ...] = ()
            if closer is not None:
                near, behind = closer.over(background)
                parts = self._compared(rasterize(gaussians, closer.camera, behind), closer, near, behind)
            loss = loss + detail_loss(image, target, box, self._settings.dssim_weight, parts)
        if self._settings.alpha_weight:
            off = (render.alpha - view.mask).abs()
            for unknown in (view.hidden, view.doubted):
                off = off if unknown is None else off * ~unknown
            loss = loss + self._settings.alpha_weight * off.mean()
        return Step(loss, target, view, image)

    def _compared(self, render: Render, view: TrainingView, target: Tensor, behind: Tensor) -> tuple[Tensor, Tensor]:
        """A render over `behind` in the colors of the view, and the (H, W, 3) target to compare it with."""
        image = view.in_its_colors(render.image, render.alpha, behind)
        if self.chroma_shift is not None and view.chroma is not None:
            image = resampled(image, view.chroma, self.chroma_shift)
        if view.hidden is None:
            return image, target
        seen = ~view.hidden[..., None]
        return image * seen, target * seen

    @torch.no_grad()
    def error(self, gaussians: Gaussians, view: TrainingView) -> Tensor:
        """(H, W) mean absolute difference of the channels between a render of all splats over black and a view."""
        black = torch.zeros(3, device=view.device)
        target, behind = view.over(black)
        image, target = self._compared(rasterize(gaussians, view.camera, behind), view, target, behind)
        return (image - target).abs().mean(-1)

    def state(self) -> dict[str, Tensor]:
        """Position in the sequence of views. The caller stores the state of the generator."""
        return {"views": torch.tensor(self._left, dtype=torch.int64)}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`."""
        self._left = [int(index) for index in state["views"]]


def regularized(loss: Tensor, gaussians: Gaussians, settings: TrainSettings, extent: float) -> Tensor:
    """A loss plus what opacities and scales cost; `extent`: of the scene, world units."""
    if settings.opacity_reg:
        loss = loss + settings.opacity_reg * gaussians.opacities.mean()
    if settings.scale_reg:
        loss = loss + settings.scale_reg / extent * gaussians.scales.mean()
    return loss


def part_of(state: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The values of a checkpoint whose names begin with a prefix, by the rest of their names."""
    return {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
