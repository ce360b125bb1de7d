"""The stage `train`: groups in parallel, in each the keyframe and then frame after frame, to the end and to the start.

The file of each frame holds a key, a digest of everything it was made from. That of a keyframe covers settings of
keyframe training, seed, footage, cameras and initial points; that of another frame covers the key of the frame that
it starts from, its frame number, and settings of motion and fine-tuning. So when a take gets longer, the frames of
complete groups stay valid; when fine-tuning changes, keyframes stay valid; and a resumed group continues exactly where
it stopped.

Where the group is then trained jointly, each frame is replaced, with one key for the group that covers the keys of its
frames. What was there before is kept beside it, so that another joint training, or a longer take, starts from it.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path

from v3studio.pipelines.stages import Executor, stage_named
from v3studio.pipelines.stages.baking.live import LiveBake
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, key_of
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.camera_colors import ensure_camera_colors
from v3studio.pipelines.stages.training.camera_refinement import drop_refined_cameras, ensure_refined_cameras
from v3studio.pipelines.stages.training.footage_check import footage_check
from v3studio.pipelines.stages.training.group import GroupJob, train_group
from v3studio.pipelines.stages.training.group_scheduler import refuse_too_little_memory, run_groups, sides_at_once
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.stages.training.progress import Previews, TrainClock, TrainProgress
from v3studio.pipelines.stages.training.views import ViewReader
from v3studio.pipelines.takes.authored.edits import edit_params
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.pipelines.takes.results.summaries import TrainSummary
from v3studio.studio.atomic_files import remove
from v3studio.studio.counts import counted

STAGE = stage_named("train")


def params(inputs: Inputs) -> Params:
    """Training views, training settings, marked details, and frames."""
    plan = TrainPlan(inputs)
    return {
        **plan.recipe,
        **plan.later,
        **plan.joint,
        **edit_params(inputs.edits, "details"),
        "frames": list(inputs.raw_footage.frames),
        "groups": [group.first for group in plan.groups],
    }


def results(inputs: Inputs) -> list[Path]:
    """One file per frame, the colors of the cameras, and what refining the cameras changed."""
    plan = TrainPlan(inputs)
    colors = [] if plan.settings.camera_colors is None else [plan.take.camera_colors]
    refinement = [plan.take.camera_refinement] if plan.refines else []
    return colors + refinement + [path for group in plan.groups for path in plan.frame_paths(group)]


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """Frames trained with current settings and inputs."""
    plan = TrainPlan(inputs)
    done = sum(len(plan.trained(group)) for group in plan.groups)
    return done, sum(len(group.frames) for group in plan.groups), "frames"


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> TrainSummary:
    """Train the frames that are missing."""
    plan = TrainPlan(inputs)
    plan.refuse_without_cameras()
    done = {group.index for group in plan.groups if plan.is_done(group)}
    todo = [group for group in plan.groups if group.index not in done]
    if executor is None and todo:
        refuse_too_little_memory(inputs)
    if executor is None or not todo:  # else those that train the groups need it, and have the devices
        _fit_cameras(plan, reporter)
    reporter.start_clock()
    with LiveBake(inputs, reporter, done) if inputs.config.run.live else nullcontext() as live:
        written = (lambda group: None) if live is None else live.written
        if executor is None:
            _train_groups(plan, reporter, todo, plan.at_once, written=written, lock=True)
        else:
            executor.run(STAGE, inputs, todo, reporter, lambda group: written(group.index))
    trained = []
    for group in plan.groups:
        _drop_leftovers(plan, group)
        trained.append(read_model(plan.take.train_group(group.index) / "group.json", TrainedGroup))
    if plan.settings.camera_colors is None:
        remove(plan.take.camera_colors)
    plan.take.keep_groups(STAGE.name, len(plan.groups))
    return TrainSummary(
        groups=len(plan.groups),
        frames=sum(len(group.frames) for group in plan.groups),
        splats=tuple(report.splats for report in trained),
        outlines_off=tuple(report.outlines_off and round(report.outlines_off, 1) for report in trained),
    )


def _train_groups(
    plan: TrainPlan,
    reporter: StageReporter,
    groups: Sequence[Group],
    at_once: int,
    *,
    lock: bool,
    written: Callable[[int], None] = lambda group: None,
) -> None:
    """Train groups that are not done, `at_once` in parallel, and meanwhile check the frames that are not trained yet.
    `lock`: whether the groups are still to be locked; `written`: called with the number of a group when all of its
    frames are there."""
    if not groups:
        return
    trained = {group.index: plan.trained(group) for group in groups}
    for group in groups:
        if done := len(trained[group.index]):
            reporter.log(f"group {group.index}: {done} of {counted(len(group.frames), 'frame')} are already trained")
    keys = {group.index: plan.keys_to_write(group) for group in groups}
    run, views = plan.inputs.config.run, ViewReader.of(plan.inputs)
    progress = TrainProgress(reporter, TrainClock(groups, trained, plan.settings))
    background = plan.inputs.config.evaluate.background
    previews = Previews(reporter, views.footage, plan.take.previews, background, views.device, run.preview_seconds)

    def train(group: Group) -> None:
        with plan.take.group_locked(STAGE.name, group.index, progress.check) if lock else nullcontext():
            if not plan.is_done(group):
                job = GroupJob(
                    plan=plan,
                    group=group,
                    keys=keys[group.index],
                    trained=plan.trained(group),
                    views=views,
                    previews=previews,
                    readers=max(1, plan.inputs.threads // at_once),
                    sides_at_once=sides_at_once(plan.inputs, plan.threads[group.index]),
                )
                train_group(job, progress)
        written(group.index)

    frames = tuple(frame for group in groups for at, frame in enumerate(group.frames) if at not in trained[group.index])
    checks = run.check_footage and frames
    with footage_check(views.footage, frames, progress.stop, reporter) if checks else nullcontext():
        run_groups({group.index: partial(train, group) for group in groups}, at_once, plan.threads, progress.stop)


def group_key(inputs: Inputs, group: Group) -> str:
    """The digest of a group: the keys of its outermost frames cover those between them."""
    plan = TrainPlan(inputs)
    keys = plan.final_keys(plan.keys(group))
    return key_of(STAGE.name, STAGE.version, keys[0], keys[-1])


def group_done(inputs: Inputs, group: Group) -> bool:
    return TrainPlan(inputs).is_done(group)


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    refuse_too_little_memory(inputs)
    plan = TrainPlan(inputs)
    _fit_cameras(plan, reporter)
    _train_groups(plan, reporter, (group,), 1, lock=False)


def _fit_cameras(plan: TrainPlan, reporter: StageReporter) -> None:
    """Fit the colors of the cameras, and refine the cameras, if that is wanted and not done yet."""
    if plan.colors_key is not None:
        ensure_camera_colors(plan, reporter, plan.colors_key)
    if plan.refinement_key is not None:
        ensure_refined_cameras(plan, reporter, plan.refinement_key)
    else:
        drop_refined_cameras(plan)


def _drop_leftovers(plan: TrainPlan, group: Group) -> None:
    """Delete frames that no plan wants: of an earlier length of the group, or from before joint training."""
    take, wanted = plan.take, set(plan.frame_paths(group))
    if plan.settings.joint_iterations:
        wanted |= {take.separate_frame(group.index, index) for index in group.indices}
    folder = take.train_group(group.index)
    for path in (*folder.glob("frame_*.safetensors"), *folder.glob("separate_*.safetensors")):
        if path not in wanted:
            remove(path)
