"""The stage `bake`: plans the groups of the stream, encodes those that are missing, and publishes the stream.

Groups are encoded into a work folder. When all are finished, the take's stream gets the new files and then the new
manifest. Valid groups of the old stream are reused. Rungs of the ladder that keep only a share of the splats are
fine-tuned first; see `baking.rungs`.
"""

from pathlib import Path

from v3studio.pipelines.stages import Executor, stage_named
from v3studio.pipelines.stages.baking.encode import encode, encode_once
from v3studio.pipelines.stages.baking.plan import BakePlan
from v3studio.pipelines.stages.baking.publish import publish
from v3studio.pipelines.stages.baking.rungs import finetuned_rungs, finetuning_params
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.authored.edits import edit_params
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.records import digests_on_record
from v3studio.pipelines.takes.results.summaries import BakeSummary
from v3studio.studio.atomic_files import remove
from v3studio.studio.capture.digest import digest_files
from v3studio.studio.stream.attributes import VERSION

STAGE = stage_named("bake")


def params(inputs: Inputs) -> Params:
    """Encoding settings, and the contents of the manifest."""
    sound, behind = inputs.raw_footage.sound, inputs.take.set_splats
    return {
        **(finetuning_params(inputs) if finetuned_rungs(inputs.config) else {}),
        **settings_affecting(inputs.config, "videos", "manifest", "sound"),
        "frames a second": float(inputs.raw_footage.fps),
        "version of the stream": VERSION,
        **({} if not behind.is_file() else {"set": digest_files(behind.parent, [behind])}),
        **({} if sound is None else {"sound": digest_files(sound.path.parent, [sound.path])}),
        **edit_params(inputs.edits),
    }


def results(inputs: Inputs) -> list[Path]:
    """All files of the stream."""
    return sorted(path for path in inputs.take.stream.rglob("*") if path.is_file())


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """Groups that are baked with current settings and inputs."""
    plan = BakePlan(inputs)
    known = digests_on_record(inputs.take, *STAGE.dependencies, STAGE.name)
    return sum(plan.baked(part, known) is not None for part in plan.parts), len(plan.parts), "groups"


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> BakeSummary:
    """Bake the groups that are missing, then publish the stream."""
    from v3studio.studio.stream import GroupEntry
    from v3studio.studio.stream.encode.decoder_limits import beyond_hardware

    plan, settings = BakePlan(inputs), inputs.config.bake
    if executor is not None:
        executor.run(STAGE, inputs, inputs.groups, reporter)
    plan.folder.mkdir(parents=True, exist_ok=True)
    notes, best = [], []
    for position, part in enumerate(plan.parts):
        start, stop = position / len(plan.parts), (position + 1) / len(plan.parts)
        note = plan.baked(part) or encode_once(plan, part, reporter, start, stop)
        notes.append(note)
        entry = GroupEntry.from_dict(note.entry)
        best.append(entry.best)
        for message in beyond_hardware(entry, float(inputs.raw_footage.fps)):
            reporter.warn(message)
        figures = {"splats": entry.best.splats, "bytes": entry.best.bytes, "frames": entry.frame_count}
        reporter.metrics(figures, group=part.index)
        reporter.progress(stop, f"group {part.index}")
    manifest = publish(plan, notes, live=False, reporter=reporter)
    remove(plan.folder)
    for path in set(inputs.take.work(STAGE.name).glob("group_*.json")) - set(map(plan.note_path, plan.parts)):
        remove(path)
    psnrs = [rendition.psnr_to_trained for rendition in best if rendition.psnr_to_trained is not None]
    return BakeSummary(
        groups=len(plan.parts),
        frames=manifest.frame_count,
        renditions=max(1, len(settings.ladder)),
        bytes=manifest.total_bytes,
        bytes_per_frame=round(manifest.played_bytes() / manifest.frame_count),
        qps=tuple(rendition.qp for rendition in best),
        psnr_to_trained=min(psnrs, default=None),
        unsmoothed=tuple(part.index for part, note in zip(plan.parts, notes, strict=True) if not note.smoothed),
    )


def group_key(inputs: Inputs, group: Group) -> str:
    plan = BakePlan(inputs)
    return key_of(STAGE.name, STAGE.version, [plan.key(part) for part in plan.of_group(group)])


def group_done(inputs: Inputs, group: Group) -> bool:
    plan = BakePlan(inputs)
    return all(plan.baked(part) is not None for part in plan.of_group(group))


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    plan = BakePlan(inputs)
    parts = plan.of_group(group)
    for position, part in enumerate(parts):
        if plan.baked(part) is None:
            encode(plan, part, reporter, position / len(parts), (position + 1) / len(parts))
