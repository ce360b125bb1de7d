"""Fewer splats: trains what remains of a group when only some of its splats are kept.

The kept splats have to cover what the others covered: they grow, move and change color. What is trained is one offset
of each attribute of each splat, the same in all frames of the group, so that paths, order and smoothness in time stay
what they are in the full set, and the stream codes them as cheaply. Trained frame after frame, splats match each frame
more closely, but their jitter costs more than that once the stream is coded (docs/measurements/stream.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from v3studio.studio.errors import StudioError
from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.torch_rotations import quat_multiply
from v3studio.studio.training.group_run import Leaves, train_group
from v3studio.studio.training.interframe import performer_box
from v3studio.studio.training.keyframe import scene_extent
from v3studio.studio.training.settings import MEANS_FINETUNE_RATE, TrainSettings
from v3studio.studio.training.splat_optimizer import joined_sh
from v3studio.studio.training.step import Checkpoint, CheckpointFn, Stepper, regularized
from v3studio.studio.training.views import TrainingView


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
        """The kept splats of a frame of the full set, without offsets."""
        if (len(self.kept) and int(self.kept[-1]) >= len(frame)) or self.sh_degree > frame.sh_degree:
            value, expected = [int(self.kept[-1]), self.sh_degree], [len(frame) - 1, frame.sh_degree]
            problem = (
                f"offsets of splats up to number {value[0]} and of SH degree {value[1]} do not fit {len(frame)} splats "
                f"of degree {frame.sh_degree}"
            )
            raise StudioError("training.offsets_mismatch", problem, value=value, expected=expected)
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
        """Return the tensors by name; they can be stored as safetensors."""
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
    checkpoint: CheckpointFn | None = None,
    resume: Checkpoint | None = None,
) -> SplatOffsets:
    """Train offsets with the losses of keyframe fine-tuning (equation 7, opacity and scale, dropout).

    Args:
        frames: some trained frames of the group, with all splats, in order.
        views: training views of each of these frames.
        kept: (M,) int64 indices of the splats to keep, ascending.
        seed: equal seeds and inputs give equal offsets, bit for bit.
        progress, checkpoint, resume: see `train_group`.

    Raises:
        StudioError: `training.diverged`, `training.no_views`, `training.offsets_mismatch`.
    """
    start = SplatOffsets.zeros(kept, sh_degree)
    selected = [start.selected(frame) for frame in frames]
    extent = scene_extent(torch.stack(performer_box(selected[0].means)))
    rates = settings.rates
    trained = {
        "means": (start.means, MEANS_FINETUNE_RATE * extent),
        "rotation": (start.rotation, rates.rotation),
        "log_scales": (start.log_scales, rates.scale),
        "logit_opacities": (start.logit_opacities, rates.opacity),
        "sh_dc": (start.sh[:, :1], rates.sh_dc),
        "sh_rest": (start.sh[:, 1:], rates.sh_rest),
    }

    def offsets(leaves: Leaves) -> SplatOffsets:
        parts = {name: leaves[name] for name in ("means", "rotation", "log_scales", "logit_opacities")}
        return SplatOffsets(kept, **parts, sh=joined_sh(leaves))

    def gaussians(leaves: Leaves, frame: int) -> Gaussians:
        return offsets(leaves).applied(selected[frame])

    def loss(photometric: Tensor, splats: Gaussians, leaves: Leaves, frame: int) -> Tensor:
        return regularized(photometric, splats, settings, extent)

    generator = torch.Generator().manual_seed(seed)
    steppers = [Stepper(seen, settings, generator) for seen in views]
    leaves = train_group(steppers, trained, gaussians, loss, iterations, "fine-tuning", progress, checkpoint, resume)
    return SplatOffsets(*(value.detach().cpu().clone() for value in vars(offsets(leaves)).values()))
