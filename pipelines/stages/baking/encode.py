"""Encodes a part of the plan: fine-tunes its rungs, bakes its renditions, and notes what they were made from."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from v3studio.pipelines.stages.baking.measures import RenderedError, rendered_contribution
from v3studio.pipelines.stages.baking.plan import BakePlan, Part, group_to_bake, stream_cameras
from v3studio.pipelines.stages.baking.rungs import finetuned_frames, finetuned_rungs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.digests import digest_of_file
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.frames.edited import EditedGroup
from v3studio.pipelines.takes.results.stage_files import BakedGroupNote
from v3studio.studio.memory_cache import OnDemand

if TYPE_CHECKING:
    from v3studio.studio.gaussians import Gaussians


def encode_once(plan: BakePlan, part: Part, reporter: StageReporter, start: float, stop: float) -> BakedGroupNote:
    """The note on a baked part, which is encoded unless another process has done it meanwhile."""
    with plan.inputs.take.group_locked("bake", part.trained.index, lambda: reporter.progress(start)):
        return plan.baked(part) or encode(plan, part, reporter, start, stop)


def encode(plan: BakePlan, part: Part, reporter: StageReporter, start: float, stop: float) -> BakedGroupNote:
    """Encode a part into the work folder; arguments as for `encode_once`."""
    from v3studio.studio.stream import bake_group
    from v3studio.studio.stream.suggested_view import seen_box

    inputs, settings = plan.inputs, plan.inputs.config.bake
    edited = group_to_bake(inputs, part)
    frames = OnDemand(part.indices, edited.read)
    cameras, background = stream_cameras(inputs), inputs.config.evaluate.background
    finetuned, start = _finetuned(plan, part, edited, reporter, start, stop)
    rendered = RenderedError(frames, cameras, background, inputs.device)
    unsmoothed: list[int] = []
    entry = bake_group(
        frames,
        plan.folder,
        part.index,
        part.stream_first,
        settings,
        progress=reporter.part(f"group {part.index}", start, stop),
        quality=rendered if settings.target_psnr is not None or settings.ladder else None,
        threads=inputs.threads,
        fps=float(inputs.raw_footage.fps),
        contribution=partial(rendered_contribution, frames, cameras, inputs.device, reporter.check),
        finetuned=lambda rung: finetuned[rung.kind],
        unsmoothed=lambda: unsmoothed.append(part.index),
    )
    if settings.target_psnr is not None:
        reached = f"QP {entry.best.qp} has {entry.best.psnr_to_trained:.2f} of {settings.target_psnr:g} dB"
        reporter.log(f"group {part.index}: {reached}{', without smooth paths' if unsmoothed else ''}")
    seen = seen_box(frames[index] for index in sorted({0, len(frames) // 2, len(frames) - 1}))
    files = {file.path: plan.folder / file.path for file in entry.files}
    note = BakedGroupNote(
        key=plan.key(part),
        files={name: path.stat().st_size for name, path in files.items()},
        digests={name: digest_of_file(path) for name, path in files.items()},
        entry=entry.model_dump(mode="json"),
        smoothed=not unsmoothed,
        seen=None if seen is None else (tuple(seen[0].tolist()), tuple(seen[1].tolist())),
    )
    write_model(plan.note_path(part), note)
    return note


def _finetuned(
    plan: BakePlan, part: Part, edited: EditedGroup, reporter: StageReporter, start: float, stop: float
) -> tuple[dict[tuple[float, int | None, int], Sequence[Gaussians]], float]:
    """Frames of the fine-tuned rungs by their kind, and the progress when they are trained."""
    frames: dict[tuple[float, int | None, int], Sequence[Gaussians]] = {}
    rungs, training = finetuned_rungs(plan.inputs.config), plan.training
    new = [rung for rung in rungs if not training.finished(part.trained, rung)]
    share = 0.7 * (stop - start) / max(1, len(new))  # of the work, roughly
    for rung in rungs:
        end = start + share * (rung in new)
        progress = reporter.part(f"group {part.index}: fine-tuning {rung.kept}", start, end)
        offsets = training.offsets(part.trained, rung, reporter, progress)
        frames[rung.kind] = finetuned_frames(edited, part.indices, offsets)
        start = end
    return frames, start
