"""Keyframe training: 3DGS, then pruning and fine-tuning (paper section 4.1, Key Frame Reconstruction)."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from v3studio.studio.dilation import DILATION
from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import SH_C0, Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer.contribution import contribution
from v3studio.studio.training import settings as constants
from v3studio.studio.training.densify import control_density
from v3studio.studio.training.details import detail_weights
from v3studio.studio.training.pruning import prune_rounds, pruned_in_round
from v3studio.studio.training.refine import Refinement
from v3studio.studio.training.settings import TrainSettings
from v3studio.studio.training.splat_optimizer import SplatOptimizer
from v3studio.studio.training.step import (
    SNAPSHOT_EVERY,
    Checkpoint,
    CheckpointFn,
    SnapshotFn,
    Stepper,
    part_of,
    regularized,
)
from v3studio.studio.training.views import TrainingView

FIRST_OPACITY = 0.1


def initial_gaussians(
    points: Tensor, colors: Tensor, sh_degree: int, dilation: float = DILATION, opacity: float = FIRST_OPACITY
) -> Gaussians:
    """Initial splats as in 3DGS: isotropic, with the mean distance to the three nearest points as scale.

    Args:
        points: (N, 3) world positions, N >= 4.
        colors: (N, 3) RGB in 0 to 1.
        sh_degree: 0 to 3; coefficients above degree 0 start at zero.
        dilation: that they are rendered with, square pixels.
        opacity: of all of them, 0 to 1.
    """
    from scipy.spatial import cKDTree

    if len(points) < 4:
        problem = f"{len(points)} initial points; a keyframe needs at least 4"
        raise StudioError("training.too_few_points", problem, value=len(points), fix="Run the initialize stage again")
    if not bool(torch.isfinite(points).all()):
        count = int((~torch.isfinite(points)).any(-1).sum())
        problem = f"{count} of {len(points)} initial points have a coordinate that is not finite"
        raise StudioError("training.points_not_finite", problem, value=count, fix="Run the initialize stage again")
    array = points.cpu().double().numpy()
    distance = cKDTree(array).query(array, k=4)[0][:, 1:].mean(1)
    floor = 1e-6 * max(float(np.ptp(array, axis=0).max()), 1e-9)
    size = torch.from_numpy(np.maximum(distance, floor)).float().to(points.device)
    n = len(points)
    quats = torch.zeros(n, 4, device=points.device)
    quats[:, 0] = 1
    sh = torch.zeros(n, (sh_degree + 1) ** 2, 3, device=points.device)
    sh[:, 0] = (colors.float() - 0.5) / SH_C0
    logit = torch.full((n,), opacity, device=points.device).logit()
    return Gaussians(points.float(), quats, size.log()[:, None].repeat(1, 3), logit, sh, dilation)


def scene_extent(points: Tensor) -> float:
    """Diagonal of the bounding box of (N, 3) points in world units. Learning rates and size limits are relative to it.

    3DGS uses the spread of the cameras instead, but the size of a performer does not depend on the camera distance.
    """
    return float((points.amax(0) - points.amin(0)).norm().clamp_min(1e-9))


def train_keyframe(
    views: Sequence[TrainingView],
    points: Tensor,
    colors: Tensor,
    settings: TrainSettings,
    *,
    seed: int = 0,
    progress: ProgressFn = no_progress,
    snapshot: SnapshotFn | None = None,
    snapshot_every: int = SNAPSHOT_EVERY,
    checkpoint: CheckpointFn | None = None,
    resume: Checkpoint | None = None,
    compared: Callable[[Refinement], None] | None = None,
    coarse: Sequence[TrainingView] | None = None,
    wanted: Callable[[Gaussians], Tensor] | None = None,
    first_opacity: float = FIRST_OPACITY,
) -> Gaussians:
    """Train a keyframe: 3DGS with densification, then rounds of pruning by opacity and fine-tuning.

    Args:
        views: training views of the keyframe.
        points: (N, 3) initial means (sampled from the mesh), world units.
        colors: (N, 3) RGB of the points, 0 to 1.
        settings: see `TrainSettings`.
        seed: equal seeds and inputs give equal splats, bit for bit.
        progress: called with completed and total steps, and regularly also with `loss`, `psnr` (dB, of the last
            training crop) and `splats`.
        snapshot: called with the splats every `snapshot_every` steps.
        checkpoint: called with the complete state every `CHECKPOINT_EVERY` steps.
        resume: a checkpoint of the same inputs, settings and seed. The result equals that of an uninterrupted run.
        compared: called at the end, with how masks and splats compared before pruning; later frames need its `off`.

        coarse: as many views of fewer pixels, which are seen until pruning; None: `views`.
        wanted: returns (N,) bool, the splats that stay, every `densify_every` steps before pruning; None: all stay.
        first_opacity: of the initial splats, 0 to 1.

    Returns:
        Detached splats, at most `settings.max_splats`.

    Raises:
        StudioError: `training.too_few_points`, `training.points_not_finite`, `training.no_views`, `training.diverged`,
            `training.no_splats_left`, or `training.checkpoint_incomplete`.
        Cancelled: raised by `progress`.
    """
    start = initial_gaussians(points, colors, settings.sh_degree, settings.dilation, first_opacity)
    run = _Run(views, coarse or views, start, settings, seed, progress, wanted)
    if resume is not None:
        run.restore(resume)
    while not run.finished:
        run.step()
        if snapshot is not None and run.done % snapshot_every == 0:
            snapshot(run.done, run.optimizer.gaussians.detach())
        if checkpoint is not None and run.done % constants.CHECKPOINT_EVERY == 0:
            checkpoint(run.done, run.state())
    if compared is not None:
        compared(run.refinement)
    return run.optimizer.gaussians.clone()


class _Run:
    """Training of one keyframe: the state that changes in each step."""

    def __init__(
        self,
        views: Sequence[TrainingView],
        coarse: Sequence[TrainingView],
        start: Gaussians,
        settings: TrainSettings,
        seed: int,
        progress: ProgressFn,
        wanted: Callable[[Gaussians], Tensor] | None,
    ) -> None:
        self._settings, self._progress, self._views, self._wanted = settings, progress, views, wanted
        self._extent = scene_extent(start.means)
        self._generator = torch.Generator().manual_seed(seed)
        self._stepper = Stepper(coarse, settings, self._generator)
        self._details = views[0].details
        self.refinement = Refinement(self._stepper, settings)
        self.optimizer = SplatOptimizer(start, settings.rates, self._extent)
        self.done = 0
        self._rounds = prune_rounds(settings, min(len(start), settings.max_splats))
        self._pruned = 0

    @property
    def finished(self) -> bool:
        """Tell whether all steps and all pruning rounds are done."""
        return self.done >= self._total and (self._pruned >= self._rounds)

    @property
    def _total(self) -> int:
        return self._settings.keyframe_iterations + self._rounds * self._settings.prune_finetune_iterations

    def step(self) -> None:
        """Run one step, including pruning or densification if due."""
        settings = self._settings
        if self.done < settings.keyframe_iterations:
            self._grow()
            if self.done == settings.keyframe_iterations:
                self._rounds = prune_rounds(settings, len(self.optimizer))
                self._stepper.views = self._views
            return
        if settings.prune_finetune_iterations:
            self.refinement.before_step(self.done - settings.keyframe_iterations, self.optimizer.gaussians)
        due = settings.keyframe_iterations + self._pruned * settings.prune_finetune_iterations
        if self._pruned < self._rounds and self.done == due:
            self._prune()
            self._pruned += 1
        if settings.prune_finetune_iterations:
            self._advance(self.optimizer.gaussians)

    def _prune(self) -> None:
        optimizer, settings = self.optimizer, self._settings
        gaussians = optimizer.gaussians.detach()
        if settings.prune_by == "contribution":
            importance = contribution(gaussians, [view.camera for view in self._stepper.views])
        else:
            importance = gaussians.logit_opacities if not self._details else gaussians.opacities
        importance = importance * detail_weights(gaussians.means, self._details)
        prune(optimizer, importance, pruned_in_round(settings, len(optimizer), self._pruned))

    def _grow(self) -> None:
        settings, optimizer = self._settings, self.optimizer
        iteration = self.done + 1
        optimizer.set_means_progress(iteration / settings.keyframe_iterations)
        degree = min(settings.sh_degree, iteration // settings.sh_degree_every)
        gaussians = optimizer.gaussians
        if degree < settings.sh_degree:
            gaussians = gaussians.with_sh_degree(degree)
        self._advance(gaussians)
        control_density(iteration, optimizer, self._stepper, self._extent, settings)
        if self._wanted is not None and iteration % settings.densify_every == 0:
            optimizer.keep(self._wanted(optimizer.gaussians.detach()))
        if len(optimizer) == 0:
            problem = f"keyframe training removed all splats at step {iteration}"
            fix = "Check the masks and the calibration"
            raise StudioError("training.no_splats_left", problem, fix=fix, step=iteration)

    def _advance(self, gaussians: Gaussians) -> None:
        step = self._stepper(gaussians, dropout=True)
        regularized(step.loss, gaussians, self._settings, self._extent).backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        self.done += 1
        self._progress(self.done, self._total, **step.figures(self.done, "keyframe", len(self.optimizer)))

    def state(self) -> Checkpoint:
        """The complete state, for `restore`."""
        return {
            "done": torch.tensor(self.done),
            "rounds": torch.tensor(self._rounds),
            "pruned": torch.tensor(self._pruned),
            "generator": self._generator.get_state(),
            **{f"splats.{name}": value for name, value in self.optimizer.state().items()},
            **{f"stepper.{name}": value for name, value in self._stepper.state().items()},
            **{f"refinement.{name}": value for name, value in self.refinement.state().items()},
        }

    def restore(self, state: Checkpoint) -> None:
        """Continue from a `state()`, bit for bit."""
        try:
            self.done, self._rounds, self._pruned = (int(state[name]) for name in ("done", "rounds", "pruned"))
            self.optimizer.restore(part_of(state, "splats."))
            self.optimizer.set_means_progress(self.done / self._settings.keyframe_iterations)
            self._stepper.restore(part_of(state, "stepper."))
            if self.done >= self._settings.keyframe_iterations:
                self._stepper.views = self._views
            self.refinement.restore(part_of(state, "refinement."))
            self._generator.set_state(state["generator"].cpu())
        except KeyError as error:
            problem = f"the keyframe checkpoint does not contain {error}"
            fix = "Delete the checkpoint to train the keyframe from the start"
            raise StudioError("training.checkpoint_incomplete", problem, value=str(error.args[0]), fix=fix) from None


def prune(optimizer: SplatOptimizer, importance: Tensor, count: int) -> None:
    """Remove the `count` splats with the lowest `importance`, (N,); the others keep their order."""
    order = torch.argsort(importance, stable=True)
    optimizer.keep(order[count:].sort().values)
