"""Training of a group as a whole, after its frames were trained one after the other.

Frame after frame, every attribute of every splat changes a little, and most of these changes are noise that costs bits
and shows in new views. So a few frames in a row share scales, opacities and colors here, and random frames and views
decide on them together. Positions and rotations stay those of each frame; what they cost is the acceleration of
positions. Splats that hardly contribute to what the cameras see cost bytes, too, and are left out first.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from v3studio.studio.gaussians import Gaussians
from v3studio.studio.progress import ProgressFn, no_progress
from v3studio.studio.rasterizer.contribution import contribution
from v3studio.studio.training.details import detail_weights
from v3studio.studio.training.group_run import Leaves, train_group
from v3studio.studio.training.interframe import performer_box
from v3studio.studio.training.keyframe import scene_extent
from v3studio.studio.training.refine import Refinement
from v3studio.studio.training.settings import MEANS_FINETUNE_RATE, LearningRates, TrainSettings
from v3studio.studio.training.splat_optimizer import joined_sh
from v3studio.studio.training.step import Checkpoint, CheckpointFn, Stepper
from v3studio.studio.training.unseen import settled_colors
from v3studio.studio.training.views import TrainingView

_SMOOTHNESS = 0.1  # weight of the mean acceleration of positions (L1), relative to the performer's size
_SHARED = 8  # frames in a row that share scales, opacities and colors, about
_LEFT_OUT = 0.025
"""Most of the contribution to all images that is left out, with the splats that have the smallest ones (measured)."""

_BYTES, _BYTES_A_PIXEL = 2_000_000_000, 11  # most memory for the views of a group, and what a pixel of a view takes


def joint_steps(settings: TrainSettings, frames: int) -> int:
    """Number of joint training steps of a group with this many frames."""
    return settings.joint_iterations * frames if frames > 1 else 0


def joint_bytes(pixels: int, frames: int) -> int:
    """Most memory that the views of a group take, if those of a frame have so many pixels."""
    return min(_BYTES, _BYTES_A_PIXEL * pixels * frames)


def views_of_frame(views: Sequence[TrainingView], pixels: int, frames: int, position: int) -> list[TrainingView]:
    """The views of a frame for joint training: all, or what fits into memory, other cameras in each frame."""
    every = min(len(views), -(-_BYTES_A_PIXEL * pixels * frames // _BYTES))
    return [view.uncached() for view in views[position % every :: every]]


def parts_of(frames: int) -> list[int]:
    """Return the number of the part to which each frame of a group belongs; the frames of a part share attributes."""
    parts = max(1, round(frames / _SHARED))
    return [frame * parts // frames for frame in range(frames)]


def train_jointly(
    frames: Sequence[Gaussians],
    views: Sequence[Sequence[TrainingView]],
    settings: TrainSettings,
    *,
    keyframe_off: float | None = None,
    seed: int = 0,
    progress: ProgressFn = no_progress,
    checkpoint: CheckpointFn | None = None,
    resume: Checkpoint | None = None,
) -> list[Gaussians]:
    """Train all frames of a group together, without the splats that hardly contribute to any image.

    Args:
        frames: the group's frames as trained one after the other, at least two, in order.
        views: training views of each frame, at least one.
        settings: see `TrainSettings`; `joint_iterations` steps per frame.
        keyframe_off: see `train_interframe`.
        seed: equal seeds and inputs give equal splats, bit for bit.
        progress, checkpoint, resume: see `train_group`.

    Returns:
        Detached splats of each frame, `splats_needed` in their order. Those of a part of the group (`parts_of`) have
        the same scales, opacities and colors, settled by the cameras of the frame in its middle.

    Raises:
        StudioError: `training.diverged`.
        Cancelled: raised by `progress`.
    """
    kept = splats_needed(frames, views)
    frames = [frame[kept] for frame in frames]
    parts, extent = parts_of(len(frames)), scene_extent(torch.stack(performer_box(frames[0].means)))
    dilation = frames[0].dilation

    def gaussians(leaves: Leaves, frame: int) -> Gaussians:
        own, part = (leaves[f"means.{frame}"], leaves[f"quats.{frame}"]), f".{parts[frame]}"
        shared = leaves[f"log_scales{part}"], leaves[f"logit_opacities{part}"], joined_sh(leaves, part)
        return Gaussians(*own, *shared, dilation)

    def loss(photometric: Tensor, splats: Gaussians, leaves: Leaves, frame: int) -> Tensor:
        around = leaves.get(f"means.{frame - 1}"), leaves.get(f"means.{frame + 1}")
        if around[0] is None or around[1] is None:
            return photometric
        bend = around[0].detach() - 2 * splats.means + around[1].detach()
        return photometric + _SMOOTHNESS / extent * bend.abs().sum(-1).mean()

    generator = torch.Generator().manual_seed(seed)
    steppers = [Stepper(seen, settings, generator) for seen in views]
    for frame_splats, stepper in zip(frames, steppers, strict=True):
        Refinement(stepper, settings, keyframe_off or 0.0).begin(frame_splats.detach())
    start, steps = _start(frames, parts, settings.rates, extent), joint_steps(settings, len(frames))
    del frames  # copies, which would stay in memory
    leaves = train_group(steppers, start, gaussians, loss, steps, "joint", progress, checkpoint, resume)
    trained: list[Gaussians] = []
    for part in sorted(set(parts)):
        same = [frame for frame, own in enumerate(parts) if own == part]
        middle = same[len(same) // 2]
        sh = settled_colors(gaussians(leaves, middle).detach(), [view.camera for view in views[middle]])
        trained += [replace(gaussians(leaves, frame).detach().clone(), sh=sh.clone()) for frame in same]
    return trained


def splats_needed(frames: Sequence[Gaussians], views: Sequence[Sequence[TrainingView]]) -> Tensor:
    """Indices, ascending, of the splats that make all but `_LEFT_OUT` of the views of three frames."""
    summed = torch.zeros(len(frames[0]), dtype=torch.float64, device=frames[0].device)
    for number in sorted({0, len(frames) // 2, len(frames) - 1}):
        seen = contribution(frames[number], [view.camera for view in views[number]])
        summed += seen * detail_weights(frames[number].means, views[number][0].details)
    values, order = summed.cpu().sort(stable=True)  # sums on a GPU differ from run to run
    return order[values.cumsum(0) >= _LEFT_OUT * values.sum()].sort().values


def _start(
    frames: Sequence[Gaussians], parts: Sequence[int], rates: LearningRates, extent: float
) -> dict[str, tuple[Tensor, float]]:
    """The tensors to train and their rates: those that a part shares as "sh_dc.1", those of a frame as "means.3"."""
    start = {}
    for part in sorted(set(parts)):
        same = [frame for frame, own in zip(frames, parts, strict=True) if own == part]
        sh = _mean(same, "sh")
        start[f"log_scales.{part}"] = (_mean(same, "log_scales"), rates.scale)
        start[f"logit_opacities.{part}"] = (_mean(same, "logit_opacities"), rates.opacity)
        start[f"sh_dc.{part}"] = (sh[:, :1], rates.sh_dc)
        start[f"sh_rest.{part}"] = (sh[:, 1:], rates.sh_rest)
    for number, frame in enumerate(frames):
        start[f"means.{number}"] = (frame.means, MEANS_FINETUNE_RATE * extent)
        start[f"quats.{number}"] = (frame.unit_quats, rates.rotation)
    return start


def _mean(frames: Sequence[Gaussians], name: str) -> Tensor:
    return torch.stack([getattr(frame, name).detach() for frame in frames]).mean(0)
