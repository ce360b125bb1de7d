"""Fine-tunes the splats that rungs of the ladder keep, once per trained group. Bakes use the results in the take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from v3studio.pipelines.config import Config
from v3studio.pipelines.stages.baking.measures import rendered_contribution
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, derived_seed, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.views import ViewReader
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.frames.edited import EditedGroup
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, has_key, read_frame, read_tensors, write_tensors
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.records import result_of
from v3studio.studio.atomic_files import remove
from v3studio.studio.edits.edit_list import EditList
from v3studio.studio.memory_cache import OnDemand
from v3studio.studio.progress import ProgressFn
from v3studio.studio.stream.settings import Rung

if TYPE_CHECKING:
    from torch import Tensor

    from v3studio.studio.gaussians import Gaussians
    from v3studio.studio.training.offsets import SplatOffsets

VERSION = 1  # raised whenever fine-tuning changes; older results are then trained again

FRAMES = 5  # of a group that offsets are trained on: all 15 of walk16's first gave the same, with more memory


def finetuned_rungs(config: Config) -> tuple[Rung, ...]:
    """Rungs whose splats are fine-tuned: one for each combination of share, SH degree and steps."""
    rungs = {rung.kind: rung for rung in reversed(config.bake.ladder) if rung.finetuned}
    return tuple(rungs[kind] for kind in reversed(rungs))


def name_of(rung: Rung) -> str:
    """Name of a rung's offsets: splats50-sh0-1000."""
    return f"{rung.kept}-{rung.finetune_iterations}"


def finetuning_params(inputs: Inputs) -> Params:
    """Settings and inputs of fine-tuning that do not depend on the rung."""
    return {
        **inputs.seen_by_training(),
        **settings_affecting(inputs.config, "keyframe"),
        "result of calibrate": result_of(inputs.take, "calibrate"),
    }


class RungTraining:
    """Trains the offsets of rungs and keeps them in the take. Each result is a file with a key, a digest of everything
    it was made from: settings, footage, cameras, seed and the trained frames of the group. A run that was killed
    continues from the last checkpoint with the same key, and gives the same result."""

    def __init__(self, inputs: Inputs) -> None:
        self._inputs = inputs
        self._params: Params | None = None
        self._contents: dict[int, list[str]] = {}

    def key(self, group: Group, rung: Rung) -> str:
        """Digest of everything that the offsets of a rung are made from."""
        if self._params is None:
            self._params = finetuning_params(self._inputs)
        if group.index not in self._contents:
            paths = [self._inputs.take.finished_frame(group.index, index) for index in group.indices]
            self._contents[group.index] = [digest_of_file(path) if path.is_file() else "" for path in paths]
        return key_of("rung", VERSION, self._params, list(rung.kind), group.index, self._contents[group.index])

    def finished(self, group: Group, rung: Rung) -> bool:
        """Return whether there are valid offsets."""
        return has_key(self._inputs.take.splat_offsets(group.index, name_of(rung)), self.key(group, rung))

    def offsets(self, group: Group, rung: Rung, reporter: StageReporter, progress: ProgressFn) -> SplatOffsets:
        """Offsets of a rung: from the take, or trained now and written to it."""
        from v3studio.studio.training.offsets import SplatOffsets

        path, key = self._inputs.take.splat_offsets(group.index, name_of(rung)), self.key(group, rung)
        tensors = read_tensors(path, key)
        if tensors is None:
            tensors = self._train(group, rung, key, reporter, progress).to_tensors()
            write_tensors(path, tensors, FrameMetadata(key=key, group=group.index))
            remove(path.with_suffix(".checkpoint"))
        return SplatOffsets.from_tensors(tensors)

    def _train(self, group: Group, rung: Rung, key: str, reporter: StageReporter, progress: ProgressFn) -> SplatOffsets:
        import torch

        from v3studio.studio.stream.encode.bake import most_visible
        from v3studio.studio.training.offsets import train_offsets

        inputs = self._inputs
        checkpoint = inputs.take.splat_offsets(group.index, name_of(rung)).with_suffix(".checkpoint")

        def keep(step: int, state: dict[str, Tensor]) -> None:
            write_tensors(checkpoint, state, FrameMetadata(key=key, step=step, group=group.index))

        def reading(number: int, images: int) -> None:
            progress(0, rung.finetune_iterations)

        views = ViewReader.of(inputs)

        resume = read_tensors(checkpoint, key)
        if resume is not None:
            reporter.log(f"group {group.index}: resuming {rung.kept} at step {int(resume['done'])}")
        unedited = OnDemand(group.indices, EditedGroup(inputs.take, group, EditList()).read)
        footage = inputs.trained_footage
        cameras = [footage.rig[name] for name in footage.train_cameras]
        contribution = rendered_contribution(unedited, cameras, inputs.device, reporter.check)
        kept = torch.from_numpy(most_visible(contribution, rung.splats)).to(inputs.device)
        positions = sorted({round(x) for x in np.linspace(0, len(group.frames) - 1, FRAMES)})
        frames = [read_frame(inputs.take.finished_frame(group.index, group.indices[at])) for at in positions]
        return train_offsets(
            [frame.to(inputs.device) for frame in frames],
            [views.views(group.frames[at], reporter, reading) for at in positions],
            kept,
            frames[0].sh_degree if rung.sh_degree is None else min(rung.sh_degree, frames[0].sh_degree),
            # fewer splats overfit less
            inputs.config.train.replace(dropout=inputs.config.train.dropout * rung.splats),
            rung.finetune_iterations,
            seed=derived_seed(inputs.config.run.seed, "rung", group.index, name_of(rung)),
            progress=progress,
            checkpoint=keep,
            resume=resume,
        )


def finetuned_frames(group: EditedGroup, indices: range, offsets: SplatOffsets) -> Sequence[Gaussians]:
    """The frames of a rung: the splats that it keeps, with offsets, then the take's edits."""

    def made(index: int) -> Gaussians:
        return group.edited(offsets.applied(offsets.selected(group.unedited(index))), offsets.kept)

    return OnDemand(indices, made)
