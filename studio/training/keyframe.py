"""The first frame of a group: 3DGS, then prune and fine-tune (paper section 4.1, Key Frame Reconstruction)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from studio.errors import StudioError
from studio.gaussians import SH_C0, Gaussians
from studio.progress import ProgressFn, no_progress
from studio.training.densify import DensityControl
from studio.training.settings import TrainSettings
from studio.training.splat_optimizer import SplatOptimizer
from studio.training.step import SnapshotFn, Stepper, check_finite
from studio.training.views import TrainView

_FIRST_OPACITY = 0.1
_RESET_OPACITY = 0.01
_FIGURES_EVERY = 20


def initial_gaussians(points: Tensor, colors: Tensor, sh_degree: int) -> Gaussians:
    """3DGS's start: round splats as large as the mean distance to the three nearest points.

    Args:
        points: (N, 3) world positions, N >= 4.
        colors: (N, 3) RGB in 0 to 1.
        sh_degree: 0 to 3; coefficients above the constant start at zero.

    Raises:
        StudioError: fewer than four points, or one that is not finite.
    """
    from scipy.spatial import cKDTree

    if len(points) < 4:
        raise StudioError(f"Only {len(points)} initial points were given; a keyframe needs at least 4.")
    if not bool(torch.isfinite(points).all()):
        raise StudioError("An initial point has a coordinate that is not finite; run the initialise stage again.")
    array = points.cpu().double().numpy()
    distance = cKDTree(array).query(array, k=4)[0][:, 1:].mean(1)
    floor = 1e-6 * max(float(np.ptp(array, axis=0).max()), 1e-9)
    size = torch.from_numpy(np.maximum(distance, floor)).float().to(points.device)
    n = len(points)
    quats = torch.zeros(n, 4, device=points.device)
    quats[:, 0] = 1
    sh = torch.zeros(n, (sh_degree + 1) ** 2, 3, device=points.device)
    sh[:, 0] = (colors.float() - 0.5) / SH_C0
    logit = torch.full((n,), _FIRST_OPACITY, device=points.device).logit()
    return Gaussians(points.float(), quats, size.log()[:, None].repeat(1, 3), logit, sh)


def scene_extent(points: Tensor) -> float:
    """Diagonal of the points' box: the length to which 3DGS's rates and size limits are relative here.

    3DGS takes the cameras' spread; a performer is the same size however far away the cameras stand.
    """
    return float((points.amax(0) - points.amin(0)).norm().clamp_min(1e-9))


def keyframe_steps(settings: TrainSettings, splats: int) -> int:
    """Training steps that a keyframe takes if `splats` splats are left for pruning."""
    return settings.keyframe_iterations + prune_rounds(settings, splats) * settings.prune_finetune_iterations


def prune_rounds(settings: TrainSettings, splats: int) -> int:
    """Rounds of pruning `prune_ratio` until the cap holds, at least `settings.prune_rounds`."""
    rounds = 0
    while rounds < settings.prune_rounds or splats > settings.max_splats:
        splats -= max(1, int(splats * settings.prune_ratio))
        rounds += 1
    return rounds


def train_keyframe(
    views: Sequence[TrainView],
    points: Tensor,
    colors: Tensor,
    settings: TrainSettings,
    *,
    seed: int = 0,
    progress: ProgressFn = no_progress,
    snapshot: SnapshotFn | None = None,
) -> Gaussians:
    """Train the keyframe: 3DGS with densification, then prune by opacity and fine-tune until under the cap.

    Args:
        views: training cameras at the keyframe's moment.
        points: (N, 3) initial positions (sampled from the mesh), world units.
        colors: (N, 3) their RGB in 0 to 1.
        settings: see `TrainSettings`.
        seed: the same seed and input give the same splats.
        progress: told steps done and total, with `loss`, `psnr` (dB, of the last training crop) and `splats`.
        snapshot: given the splats every `settings.snapshot_every` steps.

    Returns:
        Detached splats, at most `settings.max_splats`.

    Raises:
        StudioError: unusable points or views, or training diverged.
        Cancelled: from `progress`.
    """
    generator = torch.Generator().manual_seed(seed)
    extent = scene_extent(points)
    optimizer = SplatOptimizer(initial_gaussians(points, colors, settings.sh_degree), settings.rates, extent)
    density = DensityControl(len(optimizer), extent, settings, points.device)
    stepper = Stepper(views, settings, generator)
    total = keyframe_steps(settings, min(len(optimizer), settings.max_splats))
    done = 0

    def advance(gaussians: Gaussians, screen_offsets: Tensor | None) -> None:
        nonlocal done
        # Densification needs each splat's gradient; dropout begins after it.
        step = stepper(gaussians, screen_offsets, dropout=screen_offsets is None)
        loss = step.loss
        if settings.opacity_reg:
            loss = loss + settings.opacity_reg * gaussians.opacities.mean()
        if settings.scale_reg:
            loss = loss + settings.scale_reg / extent * gaussians.scales.mean()
        loss.backward()  # type: ignore[no-untyped-call]
        if screen_offsets is not None and screen_offsets.grad is not None:
            size = (step.view.camera.width, step.view.camera.height)
            density.observe(screen_offsets.grad, step.render.radii, size, step.view.full_size)
        optimizer.step()
        done += 1
        figures = {}
        if done % _FIGURES_EVERY == 0:
            check_finite(step.loss, "Keyframe")
            figures = {"loss": float(step.loss.detach()), "psnr": step.psnr, "splats": len(optimizer)}
        progress(done, total, **figures)
        if snapshot is not None and done % settings.snapshot_every == 0:
            snapshot(done, optimizer.gaussians.detach())

    last_reset = settings.densify_until - settings.densify_until // 4
    for iteration in range(1, settings.keyframe_iterations + 1):
        optimizer.set_means_progress(iteration / settings.keyframe_iterations)
        degree = min(settings.sh_degree, iteration // max(1, settings.sh_degree_every))
        gaussians = optimizer.gaussians
        if degree < settings.sh_degree:
            gaussians = gaussians.with_sh_degree(degree)
        densifying = iteration < settings.densify_until
        offsets = torch.zeros(len(gaussians), 2, device=points.device, requires_grad=True) if densifying else None
        advance(gaussians, offsets)
        if densifying and iteration > settings.densify_from and iteration % settings.densify_every == 0:
            density.densify(optimizer, generator, remove_huge=iteration > settings.opacity_reset_every)
        if iteration % settings.opacity_reset_every == 0 and iteration <= last_reset:
            optimizer.cap_opacity(_RESET_OPACITY)
        if len(optimizer) == 0:
            raise StudioError("Keyframe: no splat is left after pruning; check masks and calibration.")

    rounds = prune_rounds(settings, len(optimizer))
    total = done + rounds * settings.prune_finetune_iterations
    for _ in range(rounds):
        prune_by_opacity(optimizer, settings.prune_ratio)
        for _ in range(settings.prune_finetune_iterations):
            advance(optimizer.gaussians, None)
    return optimizer.gaussians.clone()


def prune_by_opacity(optimizer: SplatOptimizer, ratio: float) -> None:
    """Remove the share `ratio` (at least one splat, never the last) with the lowest opacity."""
    count = len(optimizer)
    drop = min(count - 1, max(1, int(count * ratio)))
    order = torch.argsort(optimizer.gaussians.logit_opacities.detach(), stable=True)
    optimizer.keep(order[drop:].sort().values)
