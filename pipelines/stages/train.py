"""The stage `train`: groups in parallel, in each the keyframe and then frame after frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from pipelines.config.renamed import first_name, first_names
from pipelines.events.cancellation import Cancellation
from pipelines.stages.base import Context, StageReporter, leftover
from pipelines.stages.camera_colors import camera_colors_key, ensure_camera_colors
from pipelines.stages.edited import details_at
from pipelines.stages.footage_check import footage_check
from pipelines.stages.group_scheduler import groups_at_once, refuse_too_little_memory, run_groups, threads_of_groups
from pipelines.stages.live_bake import LiveBake
from pipelines.stages.params import Params, key_of, settings_affecting, settings_of, without
from pipelines.stages.summaries import TrainSummary
from pipelines.stages.train_clock import TrainClock
from pipelines.stages.train_group import GroupWork
from pipelines.takes.atomic_files import digest_of, read_model, remove
from pipelines.takes.edit_params import edit_params
from pipelines.takes.frame_files import read_about
from pipelines.takes.groups import Group
from pipelines.takes.records import result_of
from pipelines.takes.stage_files import InitialPointsReport, TrainedGroup
from studio.counts import counted
from studio.errors import Message, StudioError


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
        """Training views, training settings, marked details, and frames."""
        return {
            **self._recipe(context),
            **edit_params(context.edits, "details"),
            **settings_of(context.config, "train.group_size"),
            "frames": list(context.footage.raw.frames),
            **({} if context.config.train.grouping == "fixed" else {"groups": [one.first for one in context.groups]}),
        }

    def results(self, context: Context) -> list[Path]:
        """One file per frame, and the colors of the cameras."""
        colors = [context.take.camera_colors] if context.config.train.camera_colors else []
        return colors + [
            context.take.trained_frame(group.index, index) for group in context.groups for index in group.indices
        ]

    def units(self, context: Context) -> tuple[int, int, str] | None:
        """Frames trained with current settings and inputs."""
        groups, recipe = context.groups, self._keyframe_recipe(context)
        done = sum(self._finished(context, group, recipe) for group in groups)
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
        todo = [group for group in groups if finished[group.index] < len(group.frames)]
        if context.executor is None and todo:
            refuse_too_little_memory(context)
        if context.executor is None or not todo:  # else those that train the groups need it, and have the devices
            self._colors(context, reporter, Cancellation())
        reporter.start_clock()
        with LiveBake(context, reporter, finished) if context.config.bake.live else nullcontext() as live:
            written = (lambda group, frames: None) if live is None else live.written
            if context.executor is None:
                self._train_here(context, reporter, groups, finished, written)
            elif todo:
                context.executor.run(
                    self, context, todo, reporter, lambda group: written(group.index, len(group.frames))
                )
        splats = []
        for group in groups:
            self._drop_leftovers(context, group)
            splats.append(read_model(context.take.train_group(group.index) / "group.json", TrainedGroup).splats)
        if not context.config.train.camera_colors:
            remove(context.take.camera_colors)
        for folder in leftover(
            context.take.root / "train", [context.take.train_group(group.index) for group in groups], "group_*"
        ):
            remove(folder)
        return TrainSummary(groups=len(groups), frames=len(footage.frames), splats=tuple(splats))

    def _train_here(
        self,
        context: Context,
        reporter: StageReporter,
        groups: Sequence[Group],
        finished: Mapping[int, int],
        written: Callable[[int, int], None],
    ) -> None:
        """Train the groups of `groups` that are not finished, several at once."""
        at_once = groups_at_once(context)
        clock = TrainClock(groups, finished, context.config.train)
        work = GroupWork(context, reporter, clock, max(1, context.threads // at_once), written)
        jobs = {}
        for group in groups:
            if finished[group.index] < len(group.frames):
                of = counted(len(group.frames), "frame")
                reporter.log(f"group {group.index}: {finished[group.index]} of {of} are already trained")
                jobs[group.index] = partial(self._train, context, work, group)
        with self._checked(context, groups, finished, work):
            run_groups(jobs, at_once, threads_of_groups(context), work.stop)

    def _train(self, context: Context, work: GroupWork, group: Group) -> None:
        with context.take.group_locked(self.name, group.index, work.check):
            finished = self._finished(context, group)
            if finished < len(group.frames):
                work.train(group, finished, self._keys_to_write(context, group))

    def group_key(self, context: Context, group: Group) -> str:
        """See `GroupStage`: the key of the last frame covers those before it."""
        return self._keys(context, group)[-1]

    def group_done(self, context: Context, group: Group) -> bool:
        """See `GroupStage`."""
        return self._finished(context, group) == len(group.frames)

    def run_group(self, context: Context, group: Group, reporter: StageReporter) -> None:
        """See `GroupStage`."""
        refuse_too_little_memory(context)
        finished = self._finished(context, group)
        reporter.log(f"group {group.index}: {finished} of {counted(len(group.frames), 'frame')} are already trained")
        clock = TrainClock((group,), {group.index: finished}, context.config.train)
        work = GroupWork(context, reporter, clock, context.threads)
        self._colors(context, reporter, work.stop)
        job = partial(work.train, group, finished, self._keys_to_write(context, group))
        with self._checked(context, (group,), {group.index: finished}, work):
            run_groups({group.index: job}, 1, threads_of_groups(context), work.stop)

    def _checked(
        self, context: Context, groups: Sequence[Group], finished: Mapping[int, int], work: GroupWork
    ) -> AbstractContextManager[None]:
        """Checks the frames that are not trained yet while the block trains them."""
        if not context.config.train.check_footage:
            return nullcontext()
        frames = tuple(frame for group in groups for frame in group.frames[finished[group.index] :])
        return footage_check(context, frames, work.stop, work.reporter)

    def _colors(self, context: Context, reporter: StageReporter, stop: Cancellation) -> None:
        """Fit the colors of the cameras if that is wanted and not done yet."""
        settings = context.config.train
        if settings.camera_colors:
            ensure_camera_colors(context, reporter, camera_colors_key(context, self._keyframe_recipe(context)), stop)
        elif settings.color_chart_frame is not None:
            reporter.warn(
                Message(
                    "training.chart_unused",
                    f"train.color_chart_frame is {settings.color_chart_frame}, but the colors of the cameras are not "
                    "corrected",
                    fix="Turn train.camera_colors on, or remove the frame of the chart.",
                    fields={"setting": "train.camera_colors", "frame": settings.color_chart_frame},
                )
            )

    def _keyframe_recipe(self, context: Context) -> Params:
        return without(self._recipe(context), *settings_affecting(context.config, "later_frames"))

    def _recipe(self, context: Context) -> Params:
        """Settings and inputs of all frames."""
        return {
            **context.footage.seen_by_training(),
            **settings_affecting(context.config, "keyframe", "later_frames"),
        }

    def _keys(self, context: Context, group: Group, recipe: Params | None = None) -> list[str]:
        """Key of each frame of the group, in order; `recipe` is what `_keyframe_recipe` returns, if it is known."""
        points = context.take.initialize_group(group.index) / "report.json"
        files = read_model(points, InitialPointsReport).files if points.is_file() else None
        later = settings_affecting(context.config, "later_frames")
        recipe = self._keyframe_recipe(context) if recipe is None else recipe
        colors = [camera_colors_key(context, recipe)] if context.config.train.camera_colors else []
        start = key_of(
            self.name,
            self.version,
            recipe,
            result_of(context.take, "calibrate"),
            files,
            group.index,
            *colors,
            *details_at(context.edits, group.first),
        )
        keys = [key_of(self.name, self.version, start, group.keyframe)]
        named = first_names(later)  # as `key_of` does for each of the frames, which may be thousands
        edits = context.edits
        for index, frame in zip(group.indices[1:], group.frames[1:], strict=True):
            details = details_at(edits, index)
            keys.append(digest_of([first_name(self.name), self.version, keys[-1], named, frame, *details]))
        return keys

    def _keys_to_write(self, context: Context, group: Group) -> list[str]:
        """The keys of frames that are trained now: without the group's report they would name other initial points.

        Raises:
            StudioError: the report is missing, or a network file system does not show it here yet.
        """
        report = context.take.initialize_group(group.index) / "report.json"
        if not report.is_file():
            raise StudioError(
                "train.no_initial_points",
                "the report of the group's initial points is missing, or this machine does not see it yet",
                file=report,
                fix="Run again. If that does not help, run `v3studio initialize TAKE --force`.",
            )
        return self._keys(context, group)

    def _finished(self, context: Context, group: Group, recipe: Params | None = None) -> int:
        """Number of valid trained frames of the group, from the first without gaps."""
        take, keys = context.take, self._keys(context, group, recipe)
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
