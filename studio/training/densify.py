"""Adaptive density control of 3DGS (Kerbl et al. 2023, section 5.2) for the keyframe."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from studio.gaussians import Gaussians
from studio.torch_rotations import rotate_vectors
from studio.training.details import Detail, detail_weights
from studio.training.relocate import Relocation
from studio.training.settings import TrainSettings
from studio.training.splat_optimizer import SplatOptimizer

_DENSE_SHARE = 0.01
"""Splats larger than this fraction of the scene extent are split, smaller ones cloned (percent_dense in 3DGS)."""
_MIN_OPACITY = 0.005
RESET_EVERY = 3_000
"""Steps between opacity resets, as in 3DGS; there are none in the last quarter of densification."""
_RESET_OPACITY = 0.01
_HUGE_SHARE = 0.1
"""Splats larger than this fraction of the scene extent are removed."""


def density_control(
    count: int,
    extent: float,
    settings: TrainSettings,
    device: torch.device,
    details: Sequence[Detail] = (),
) -> DensityControl | Relocation:
    """The densification strategy selected by `settings.strategy`; arguments as for `DensityControl`."""
    if settings.strategy == "mcmc":
        return Relocation(settings, details)
    return DensityControl(count, extent, settings, device, details)


class DensityControl:
    """Accumulates screen-space gradients, and clones, splits and removes splats at the configured steps.

    Args:
        count: current number of splats.
        extent: scene extent, world units.
        settings: schedule, thresholds and maximum number of splats.
        device: device of the statistics.
        details: where gradients count more.
    """

    def __init__(
        self,
        count: int,
        extent: float,
        settings: TrainSettings,
        device: torch.device,
        details: Sequence[Detail] = (),
    ) -> None:
        self._extent, self._details = extent, details
        self._settings = settings
        self._device = device
        self._restart(count)

    def _restart(self, count: int) -> None:
        self._sum = torch.zeros(count, device=self._device)
        self._seen = torch.zeros(count, device=self._device)

    def observe(
        self, screen_gradient: Tensor, radii: Tensor, drawn_size: tuple[int, int], full_size: tuple[int, int]
    ) -> None:
        """Accumulate the gradients of one step.

        The threshold of 3DGS is for NDC units and a loss that is averaged over the full image. The loss over a crop has
        larger gradients by the ratio of the areas, so they are scaled back.

        Args:
            screen_gradient: (N, 2) gradient with respect to the 2D means, per pixel.
            radii: (N,) 0 for splats that were not drawn.
            drawn_size: (width, height) of the crop over which the loss was averaged, pixels.
            full_size: (width, height) of the uncropped image, pixels.
        """
        width, height = full_size
        area_ratio = drawn_size[0] * drawn_size[1] / (width * height)
        half = torch.tensor([width / 2, height / 2], dtype=screen_gradient.dtype)
        half = half.to(self._device, non_blocking=True)  # a blocking copy would wait for all kernels that are queued
        drawn = radii > 0
        self._sum += torch.where(drawn, (screen_gradient * half * area_ratio).norm(dim=-1), 0.0)
        self._seen += drawn

    def after_step(self, iteration: int, optimizer: SplatOptimizer, generator: torch.Generator) -> None:
        """Densify and reset opacities if due; `iteration` counts from 1."""
        settings = self._settings
        due = settings.densify_from < iteration < settings.densify_until and iteration % settings.densify_every == 0
        if due:
            self.densify(optimizer, generator, remove_huge=iteration > RESET_EVERY)
        last_reset = settings.densify_until - settings.densify_until // 4
        if iteration % RESET_EVERY == 0 and iteration <= last_reset:
            optimizer.cap_opacity(_RESET_OPACITY)

    def state(self) -> dict[str, Tensor]:
        """Statistics since the last densification, for `restore`."""
        return {"gradients": self._sum, "seen": self._seen}

    def restore(self, state: dict[str, Tensor]) -> None:
        """Continue from a `state()`."""
        self._sum, self._seen = state["gradients"].to(self._device), state["seen"].to(self._device)

    @torch.no_grad()
    def densify(self, optimizer: SplatOptimizer, generator: torch.Generator, remove_huge: bool) -> None:
        """Clone, split and remove splats once, and reset the statistics."""
        gaussians = optimizer.gaussians.detach()
        mean_gradient = self._sum / self._seen.clamp_min(1) * detail_weights(gaussians.means, self._details)
        wanted = mean_gradient > self._settings.densify_gradient
        budget = max(0, self._settings.densify_max_splats - len(optimizer))
        if int(wanted.sum()) > budget:
            order = torch.argsort(torch.where(wanted, mean_gradient, -1.0), descending=True, stable=True)
            wanted = torch.zeros_like(wanted)
            wanted[order[:budget]] = True
        size = gaussians.scales.amax(-1)
        large = size > _DENSE_SHARE * self._extent
        clone, split = wanted & ~large, wanted & large
        optimizer.append(Gaussians.cat(gaussians[clone], _halves(gaussians[split], generator)))
        after = optimizer.gaussians.detach()
        keep = after.opacities > _MIN_OPACITY
        keep[: len(gaussians)] &= ~split
        if remove_huge:
            keep &= after.scales.amax(-1) < _HUGE_SHARE * self._extent
        optimizer.keep(keep)
        self._restart(len(optimizer))


def _halves(gaussians: Gaussians, generator: torch.Generator) -> Gaussians:
    """Two children per splat, with means sampled from its distribution and scales 1.6 times smaller."""
    twice = Gaussians.cat(gaussians, gaussians)
    draws = torch.randn(twice.means.shape, generator=generator).to(twice.device) * twice.scales
    twice.means = twice.means + rotate_vectors(twice.unit_quats, draws)
    twice.log_scales = twice.log_scales - torch.log(torch.tensor(1.6))
    return twice
