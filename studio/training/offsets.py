"""Fewer splats: trains what remains of a group when only some of its splats are kept.

The kept splats have to cover what the others covered: they grow, move and change color. What is trained is one offset
of each attribute of each splat, the same in all frames of the group, so that paths, order and smoothness in time stay
what they are in the full set, and the stream codes them as cheaply. Trained frame after frame, splats match each frame
more closely, but their jitter costs more than that once the stream is coded (docs/measurements/stream.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from studio.errors import StudioError
from studio.gaussians import Gaussians
from studio.progress import ProgressFn, no_progress
from studio.torch_rotations import quat_multiply
from studio.training import settings as constants
from studio.training.adam import Adam, ParameterGroup
from studio.training.interframe import performer_box, rate_factor
from studio.training.keyframe import scene_extent
from studio.training.settings import MEANS_FINETUNE_RATE, TrainSettings
from studio.training.step import Stepper, part_of, regularized
from studio.training.views import TrainingView

OffsetCheckpoint = dict[str, Tensor]
"""The complete state of training offsets, by name; can be stored as safetensors."""


@dataclass(frozen=True)
class SplatOffsets:
    """The kept splats of a group, and what is added to each in every frame.

    Attributes:
        kept: (M,) int64 indices of the kept splats, ascending.
        means: (M, 3) world units.
        rotation: (M, 3) imaginary part of a quaternion with real part 1, applied in the splat's own axes.
        log_scales: (M, 3).
        logit_opacities: (M,).
        sh: (M, K, 3); its K coefficients are also the degree that spherical harmonics are cut to.
    """

    kept: Tensor
    means: Tensor
    rotation: Tensor
    log_scales: Tensor
    logit_opacities: Tensor
    sh: Tensor

    @classmethod
    def zeros(cls, kept: Tensor, sh_degree: int) -> SplatOffsets:
        """Offsets that change nothing."""
        count = len(kept)

        def zero(*shape: int) -> Tensor:
            return torch.zeros(count, *shape, device=kept.device)

        return cls(kept, zero(3), zero(3), zero(3), zero(), zero((sh_degree + 1) ** 2, 3))

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0 to 3."""
        return int(self.sh.shape[1] ** 0.5) - 1

    def selected(self, frame: Gaussians) -> Gaussians:
        """The kept splats of a frame of the full set, without offsets.

        Raises:
            StudioError: `training.offsets_mismatch`: the frame has too few splats or a lower SH degree.
        """
        if (len(self.kept) and int(self.kept[-1]) >= len(frame)) or self.sh_degree > frame.sh_degree:
            raise StudioError(
                "training.offsets_mismatch",
                f"offsets of splats up to number {int(self.kept[-1])} and of SH degree {self.sh_degree} do not fit "
                f"{len(frame)} splats of degree {frame.sh_degree}",
                value=[int(self.kept[-1]), self.sh_degree],
                expected=[len(frame) - 1, frame.sh_degree],
            )
        part = frame[self.kept]
        return part.with_sh_degree(self.sh_degree) if self.sh_degree < frame.sh_degree else part

    def applied(self, selected: Gaussians) -> Gaussians:
        """The splats of `selected` with the offsets added."""
        turn = torch.cat([torch.ones_like(self.rotation[:, :1]), self.rotation], dim=1)
        return Gaussians(
            selected.means + self.means,
            quat_multiply(selected.unit_quats, torch.nn.functional.normalize(turn, dim=1)),
            selected.log_scales + self.log_scales,
            selected.logit_opacities + self.logit_opacities,
            selected.sh + self.sh,
            selected.dilation,
        )

    def to_tensors(self) -> dict[str, Tensor]:
        """By name; can be stored as safetensors."""
        return dict(vars(self))

    @classmethod
    def from_tensors(cls, tensors: dict[str, Tensor]) -> SplatOffsets:
        """Inverse of `to_tensors`."""
        return cls(**{name: tensors[name] for name in cls.__dataclass_fields__})


def train_offsets(
    frames: Sequence[Gaussians],
    views: Sequence[Sequence[TrainingView]],
    kept: Tensor,
    sh_degree: int,
    settings: TrainSettings,
    iterations: int,
    *,
    seed: int = 0,
    progress: ProgressFn = no_progress,
    checkpoint: Callable[[int, OffsetCheckpoint], None] | None = None,
    checkpoint_every: int | None = None,
    resume: OffsetCheckpoint | None = None,
) -> SplatOffsets:
    """Train offsets with the losses of keyframe fine-tuning (equation 7, opacity and scale, dropout).

    Args:
        frames: some trained frames of the group, with all splats, in order.
        views: training views of each of these frames.
        kept: (M,) int64 indices of the splats to keep, ascending.
        sh_degree: to cut spherical harmonics to.
        settings: rates and losses.
        iterations: training steps, over all frames.
        seed: equal seeds and inputs give equal offsets, bit for bit.
        progress: called with completed and total steps, and regularly also with `loss`, `psnr` (dB) and `splats`.
        checkpoint: called with step and complete state every `checkpoint_every` steps. The next step modifies the
            tensors, so write or copy them.
        checkpoint_every: steps between these calls, at least 1; None for `CHECKPOINT_EVERY`.
        resume: a checkpoint of the same inputs. The result equals that of an uninterrupted run.

    Raises:
        StudioError: `training.diverged`, `training.no_views`, `training.offsets_mismatch`.
        Cancelled: raised by `progress`.
    """
    run = _Run(frames, views, SplatOffsets.zeros(kept, sh_degree), settings, iterations, seed)
    every = constants.CHECKPOINT_EVERY if checkpoint_every is None else checkpoint_every
    if resume is not None:
        run.restore(resume)
    while run.done < iterations:
        figures = run.step()
        progress(run.done, iterations, **figures)
        if checkpoint is not None and run.done % every == 0 and run.done < iterations:
            checkpoint(run.done, run.state())
    return run.result()


class _Run:
    """The state that changes in each step."""

    def __init__(
        self,
        frames: Sequence[Gaussians],
        views: Sequence[Sequence[TrainingView]],
        start: SplatOffsets,
        settings: TrainSettings,
        iterations: int,
        seed: int,
    ) -> None:
        self._settings, self._iterations = settings, iterations
        self._selected = [start.selected(frame) for frame in frames]
        self._extent = scene_extent(torch.stack(performer_box(self._selected[0].means)))
        self._generator = torch.Generator().manual_seed(seed)
        self._steppers = [Stepper(seen, settings, self._generator) for seen in views]
        rates = settings.rates
        self._rates = {
            "means": MEANS_FINETUNE_RATE * self._extent,
            "rotation": rates.rotation,
            "log_scales": rates.scale,
            "logit_opacities": rates.opacity,
            "sh_dc": rates.sh_dc,
            "sh_rest": rates.sh_rest,
        }
        values = {**start.to_tensors(), "sh_dc": start.sh[:, :1], "sh_rest": start.sh[:, 1:]}
        self._kept = start.kept
        self._leaves = {
            name: values[name].clone().requires_grad_() for name in self._rates if values[name].shape[1:].numel()
        }
        groups = [ParameterGroup([leaf], self._rates[name], name) for name, leaf in self._leaves.items()]
        self._adam = Adam(groups, eps=1e-15)
        self._order: list[int] = []
        self.done = 0

    def _offsets(self) -> SplatOffsets:
        leaves = self._leaves
        sh = leaves["sh_dc"]
        if "sh_rest" in leaves:
            sh = torch.cat([sh, leaves["sh_rest"]], dim=1)
        return SplatOffsets(
            self._kept, leaves["means"], leaves["rotation"], leaves["log_scales"], leaves["logit_opacities"], sh
        )

    def step(self) -> dict[str, float]:
        """Run one step on a view of the next frame; returns figures every few steps."""
        if not self._order:  # each frame once, in a new order
            self._order = torch.randperm(len(self._selected), generator=self._generator).tolist()
        frame = self._order.pop(0)
        factor = rate_factor(self.done / self._iterations)
        for group in self._adam.groups:
            group.rate = self._rates[group.name] * factor
        gaussians = self._offsets().applied(self._selected[frame])
        step = self._steppers[frame](gaussians, dropout=True)
        regularized(step.loss, gaussians, self._settings, self._extent).backward()  # type: ignore[no-untyped-call]
        self._adam.step()
        self._adam.zero_grad()
        self.done += 1
        return step.figures(self.done, "fine-tuning", len(gaussians))

    def result(self) -> SplatOffsets:
        """The offsets, detached, on the CPU."""
        return SplatOffsets(*(value.detach().cpu().clone() for value in vars(self._offsets()).values()))

    def state(self) -> OffsetCheckpoint:
        """The complete state, for `restore`."""
        found = {
            "done": torch.tensor(self.done),
            "generator": self._generator.get_state(),
            "order": torch.tensor(self._order, dtype=torch.int64),
        }
        for index, stepper in enumerate(self._steppers):
            found |= {f"stepper.{index}.{name}": value for name, value in stepper.state().items()}
        for name, leaf in self._leaves.items():
            found[f"{name}.value"] = leaf.detach()
            found |= {f"{name}.adam.{key}": value for key, value in self._adam.state[leaf].items()}
        return found

    def restore(self, state: OffsetCheckpoint) -> None:
        """Continue from a `state()`, bit for bit."""
        self.done = int(state["done"])
        self._generator.set_state(state["generator"].cpu())
        self._order = [int(frame) for frame in state["order"]]
        for index, stepper in enumerate(self._steppers):
            stepper.restore(part_of(state, f"stepper.{index}."))
        for name, leaf in self._leaves.items():
            with torch.no_grad():
                leaf.copy_(state[f"{name}.value"])
            moments = part_of(state, f"{name}.adam.")
            self._adam.state[leaf] = {key: value.to(leaf.device) for key, value in moments.items()}
