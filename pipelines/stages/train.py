"""The stage `train`: groups in parallel, in each the keyframe and then frame after frame."""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from pathlib import Path

from pipelines.stages.base import Context, StageReporter, leftover
from pipelines.stages.footage_check import footage_check
from pipelines.stages.group_scheduler import groups_at_once, run_groups, threads_by_group
from pipelines.stages.live_bake import LiveBake
from pipelines.stages.params import Params, key_of, settings_affecting, settings_of, without
from pipelines.stages.summaries import TrainSummary
from pipelines.stages.train_clock import TrainClock
from pipelines.stages.train_group import GroupWork
from pipelines.takes.atomic_files import read_model, remove
from pipelines.takes.frame_files import read_about
from pipelines.takes.groups import Group
from pipelines.takes.records import result_of
from pipelines.takes.stage_files import InitialPointsReport, TrainedGroup
from studio.errors import StudioError


class TrainStage:
    """The stage `train`; its units are frames.

    The file of each frame holds a key, a digest of everything it was made from. That of a keyframe covers settings of
    keyframe training, seed, footage, cameras and initial points; that of a later frame covers the key of the previous
    frame, its frame number, and settings of motion and fine-tuning. So when a take gets longer, its frames stay valid;
    when fine-tuning changes, keyframes stay valid; and a resumed group continues exactly where it stopped.
    """

    name = "train"
    title = "Training"
    version = 2
    weight = 85.0
    dependencies: tuple[str, ...] = ("calibrate", "initialize")

    def params(self, context: Context) -> Params:
        """Training views, training settings, and frames."""
        return {
            **self._recipe(context),
            **settings_of(context.config, "train.group_size"),
            "frames": list(context.footage.raw.frames),
            **({} if context.config.train.grouping == "fixed" else {"groups": [one.first for one in context.groups]}),
        }

    def results(self, context: Context) -> list[Path]:
        """One file per frame."""
        return [context.take.trained_frame(group.index, index) for group in context.groups for index in group.indices]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Frames trained with current settings and inputs."""
        groups = context.groups
        done = sum(self._finished(context, group) for group in groups)
        return done, sum(len(group.frames) for group in groups), "frames"

    def run(self, context: Context, reporter: StageReporter) -> TrainSummary:
        """Train the frames that are missing."""
        groups = context.groups
        footage = context.footage.calibrated
        if not footage.train_cameras:
            raise StudioError(
                "settings.no_training_camera",
                "all cameras are held out; none are left to train on",
                fix="Remove cameras from capture.held_out, or set capture.held_out_every to 0.",
                setting="capture.held_out",
            )
        finished = {group.index: self._finished(context, group) for group in groups}
        reporter.start_clock()
        at_once = groups_at_once(context)
        threads = threads_by_group(len(groups), at_once, context.threads)
        with LiveBake(context, reporter, finished) if context.config.bake.live else nullcontext() as live:
            clock = TrainClock(groups, finished, context.config.train)
            readers = max(1, context.threads // at_once)
            work = GroupWork(context, reporter, clock, readers, *(() if live is None else (live.written,)))
            jobs = {}
            for group in groups:
                if finished[group.index] < len(group.frames):
                    reporter.log(
                        f"group {group.index}: {finished[group.index]} of {len(group.frames)} frames are already "
                        "trained"
                    )
                    jobs[group.index] = partial(work.train, group, finished[group.index], self._keys(context, group))
            missing = tuple(frame for group in groups for frame in group.frames[finished[group.index] :])
            with footage_check(context, missing, work.stop) if context.config.train.check_footage else nullcontext():
                run_groups(jobs, at_once, threads, work.stop)
        splats = []
        for group in groups:
            self._drop_leftovers(context, group)
            splats.append(read_model(context.take.train_group(group.index) / "group.json", TrainedGroup).splats)
        for folder in leftover(
            context.take.root / "train", [context.take.train_group(group.index) for group in groups], "group_*"
        ):
            remove(folder)
        return TrainSummary(groups=len(groups), frames=len(footage.frames), splats=tuple(splats))

    def _recipe(self, context: Context) -> Params:
        """Settings and inputs of all frames."""
        return {
            **context.footage.seen_by_training(),
            **settings_affecting(context.config, "keyframe", "later_frames"),
        }

    def _keys(self, context: Context, group: Group) -> list[str]:
        """Key of each frame of the group, in order."""
        points = context.take.initialize_group(group.index) / "report.json"
        files = read_model(points, InitialPointsReport).files if points.is_file() else None
        recipe = self._recipe(context)
        later = settings_affecting(context.config, "later_frames")
        start = key_of(
            self.name,
            self.version,
            without(recipe, *later),
            result_of(context.take, "calibrate"),
            files,
            group.index,
        )
        keys = [key_of(self.name, self.version, start, group.keyframe)]
        for frame in group.frames[1:]:
            keys.append(key_of(self.name, self.version, keys[-1], later, frame))
        return keys

    def _finished(self, context: Context, group: Group) -> int:
        """Number of valid trained frames of the group, from the first without gaps."""
        take, keys = context.take, self._keys(context, group)
        count = 0
        for index, key in zip(group.indices, keys, strict=True):
            about = read_about(take.trained_frame(group.index, index))
            if about is None or about.key != key:
                break
            count += 1
        if context.config.train.motion_warm_start:
            # the next frame needs the motion network of the last finished one
            while 1 < count < len(keys):
                about = read_about(take.motion_network(group.index, group.first + count - 1))
                if about is not None and about.key == keys[count - 1]:
                    break
                count -= 1
        return count

    def _drop_leftovers(self, context: Context, group: Group) -> None:
        wanted = [context.take.trained_frame(group.index, index) for index in group.indices]
        for path in leftover(context.take.train_group(group.index), wanted, "frame_*.safetensors"):
            remove(path)
        for path in context.take.train_group(group.index).glob("motion_*.safetensors"):
            remove(path)
