"""The stage `train`: groups in parallel, in each the keyframe and then frame after frame, to the end and to the start.

The file of each frame holds a key, a digest of everything it was made from. That of a keyframe covers settings of
keyframe training, seed, footage, cameras and initial points; that of another frame covers the key of the frame that
it starts from, its frame number, and settings of motion and fine-tuning. So when a take gets longer, the frames of
complete groups stay valid; when fine-tuning changes, keyframes stay valid; and a resumed group continues exactly where
it stopped.

Where the group is then trained jointly, each frame is replaced, with one key for the group that covers the keys of its
frames. What was there before is kept beside it, so that another joint training, or a longer take, starts from it.
"""

from collections.abc import Callable, Sequence, Set
from contextlib import nullcontext
from functools import partial
from itertools import chain
from pathlib import Path

from v3studio.pipelines.stages import Executor, camera_colors, camera_refinement, stage_named
from v3studio.pipelines.stages.baking.live import LiveBake
from v3studio.pipelines.stages.camera_colors import ensure_camera_colors
from v3studio.pipelines.stages.camera_fit import fit_key, initial_files
from v3studio.pipelines.stages.camera_refinement import drop_refined_cameras, ensure_refined_cameras, refines_cameras
from v3studio.pipelines.stages.footage_check import footage_check
from v3studio.pipelines.stages.group_scheduler import (
    groups_at_once,
    refuse_too_little_memory,
    run_groups,
    threads_of_groups,
)
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params, key_of, settings_affecting
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.train_group import GroupWork, TrainClock, before_joint
from v3studio.pipelines.stages.training_views import details_at
from v3studio.pipelines.takes.authored.edits import edit_params
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.frame_files import has_key
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.records import result_of
from v3studio.pipelines.takes.results.stage_files import TrainedGroup
from v3studio.pipelines.takes.results.summaries import TrainSummary
from v3studio.studio.atomic_files import remove
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError

STAGE = stage_named("train")


def params(inputs: Inputs) -> Params:
    """Training views, training settings, marked details, and frames."""
    return {
        **_keyframe_recipe(inputs),
        **settings_affecting(inputs.config, "later_frames", "joint_frames"),
        **edit_params(inputs.edits, "details"),
        "frames": list(inputs.raw_footage.frames),
        "groups": [one.first for one in inputs.groups],
    }


def results(inputs: Inputs) -> list[Path]:
    """One file per frame, the colors of the cameras, and what refining the cameras changed."""
    colors = [inputs.take.camera_colors] if inputs.config.train.camera_colors is not None else []
    refinement = [inputs.take.camera_refinement] if refines_cameras(inputs) else []
    frames = [inputs.take.trained_frame(group.index, index) for group in inputs.groups for index in group.indices]
    return colors + refinement + frames


def units(inputs: Inputs) -> tuple[int, int, str] | None:
    """Frames trained with current settings and inputs."""
    groups, recipe = inputs.groups, _keyframe_recipe(inputs)
    done = sum(len(_finished(inputs, group, recipe)) for group in groups)
    return done, sum(len(group.frames) for group in groups), "frames"


def run(inputs: Inputs, reporter: StageReporter, executor: Executor | None) -> TrainSummary:
    """Train the frames that are missing."""
    groups = inputs.groups
    footage = inputs.calibrated_footage
    if not footage.train_cameras:
        problem = "all cameras are held out; none are left to train on"
        fix = "Remove cameras from capture.held_out."
        raise StudioError("settings.no_training_camera", problem, fix=fix, setting="capture.held_out")
    done = {group.index for group in groups if group_done(inputs, group)}
    todo = [group for group in groups if group.index not in done]
    if executor is None and todo:
        refuse_too_little_memory(inputs)
    if executor is None or not todo:  # else those that train the groups need it, and have the devices
        _prepare(inputs, reporter)
    reporter.start_clock()
    with LiveBake(inputs, reporter, done) if inputs.config.run.live else nullcontext() as live:
        written = (lambda group: None) if live is None else live.written
        if executor is None:
            _train_groups(inputs, reporter, todo, groups_at_once(inputs), written=written, lock=True)
        else:
            executor.run(STAGE, inputs, todo, reporter, lambda group: written(group.index))
    trained = []
    for group in groups:
        _drop_leftovers(inputs, group)
        trained.append(read_model(inputs.take.train_group(group.index) / "group.json", TrainedGroup))
    if inputs.config.train.camera_colors is None:
        remove(inputs.take.camera_colors)
    inputs.take.keep_groups(STAGE.name, len(groups))
    return TrainSummary(
        groups=len(groups),
        frames=len(footage.frames),
        splats=tuple(one.splats for one in trained),
        outlines_off=tuple(one.outlines_off and round(one.outlines_off, 1) for one in trained),
    )


def _train_groups(
    inputs: Inputs,
    reporter: StageReporter,
    groups: Sequence[Group],
    at_once: int,
    *,
    lock: bool,
    written: Callable[[int], None] = lambda group: None,
) -> None:
    """Train groups that are not done, `at_once` in parallel, and meanwhile check the frames that are not trained yet.
    `lock`: whether the groups are still to be locked."""
    finished = {group.index: _finished(inputs, group) for group in groups}
    for group in groups:
        if done := len(finished[group.index]):
            reporter.log(f"group {group.index}: {done} of {counted(len(group.frames), 'frame')} are already trained")
    clock = TrainClock(groups, finished, inputs.config.train)
    work = GroupWork(inputs, reporter, clock, max(1, inputs.threads // at_once), written)

    def train(group: Group, *keys: list[str]) -> None:
        with inputs.take.group_locked(STAGE.name, group.index, work.check) if lock else nullcontext():
            if not group_done(inputs, group):
                work.train(group, _finished(inputs, group), *keys)

    jobs = {group.index: partial(train, group, *_keys_to_write(inputs, group)) for group in groups}
    frames = tuple(
        frame
        for group in groups
        for position, frame in enumerate(group.frames)
        if position not in finished[group.index]
    )
    checks = inputs.config.run.check_footage and frames
    with footage_check(inputs.trained_footage, frames, work.stop, reporter) if checks else nullcontext():
        run_groups(jobs, at_once, threads_of_groups(inputs), work.stop)


def group_key(inputs: Inputs, group: Group) -> str:
    """See `GroupStageCode`: the keys of the outermost frames cover those between them."""
    keys = _final_keys(inputs, frame_keys(inputs, group))
    return key_of(STAGE.name, STAGE.version, keys[0], keys[-1])


def group_done(inputs: Inputs, group: Group) -> bool:
    return _is_final(inputs, group, frame_keys(inputs, group))


def run_group(inputs: Inputs, group: Group, reporter: StageReporter) -> None:
    refuse_too_little_memory(inputs)
    _prepare(inputs, reporter)
    _train_groups(inputs, reporter, (group,), 1, lock=False)


def _prepare(inputs: Inputs, reporter: StageReporter) -> None:
    """Fit the colors of the cameras, and refine the cameras, if that is wanted and not done yet."""
    settings, recipe = inputs.config.train, _keyframe_recipe(inputs)
    keys = _cameras_keys(inputs, recipe)
    if settings.camera_colors is not None:
        ensure_camera_colors(inputs, reporter, keys[0])
    if refines_cameras(inputs):
        ensure_refined_cameras(inputs, reporter, keys[-1])
    else:
        drop_refined_cameras(inputs)


def _cameras_keys(inputs: Inputs, recipe: Params) -> list[str]:
    """Of what is fitted to the cameras before groups are trained, if wanted: colors, then refined cameras."""
    take, first = inputs.take, inputs.groups[0]
    keys = []
    if inputs.config.train.camera_colors is not None:
        keys.append(fit_key(take, first, "camera colors", camera_colors.VERSION, recipe))
    if refines_cameras(inputs):
        keys.append(fit_key(take, first, "camera refinement", camera_refinement.VERSION, recipe, *keys))
    return keys


def _keyframe_recipe(inputs: Inputs) -> Params:
    return {**inputs.seen_by_training(), **settings_affecting(inputs.config, "keyframe")}


def frame_keys(inputs: Inputs, group: Group, recipe: Params | None = None) -> list[str]:
    """Key of each frame of the group, in order; `recipe` is what `_keyframe_recipe` returns, if it is known."""
    later = settings_affecting(inputs.config, "later_frames")
    recipe = _keyframe_recipe(inputs) if recipe is None else recipe
    calibrated, points = result_of(inputs.take, "calibrate"), initial_files(inputs.take, group)
    more = (*_cameras_keys(inputs, recipe), *details_at(inputs.edits, group.keyframe))
    start = key_of(STAGE.name, STAGE.version, recipe, calibrated, points, group.index, *more)
    keys = {group.middle: key_of(STAGE.name, STAGE.version, start, group.keyframe)}
    for position in chain(*group.sides):
        frame, before = group.frames[position], group.trained_before(position)[-1]
        details = details_at(inputs.edits, frame)
        keys[position] = key_of(STAGE.name, STAGE.version, keys[before], later, frame, *details)
    return [keys[position] for position in range(len(group.frames))]


def _final_keys(inputs: Inputs, keys: list[str]) -> list[str]:
    """The keys of a group's frames when it is done; `keys`: those of its frames before joint training."""
    if not inputs.config.train.joint_iterations or len(keys) == 1:
        return keys
    joint = key_of(STAGE.name, STAGE.version, settings_affecting(inputs.config, "joint_frames"), keys[0], keys[-1])
    return [joint] * len(keys)


def _keys_to_write(inputs: Inputs, group: Group) -> tuple[list[str], list[str]]:
    """The keys of frames that are trained now, before and after joint training: without the group's report they would
    name other initial points, so a StudioError if it is missing, or a network file system does not show it here yet."""
    report = inputs.take.initialize_group(group.index) / "report.json"
    if not report.is_file():
        problem = "the report of the group's initial points is missing, or this machine does not see it yet"
        fix = "Run again. If that does not help, run `v3studio initialize TAKE --force`."
        raise StudioError("train.no_initial_points", problem, file=report, fix=fix)
    keys = frame_keys(inputs, group)
    return keys, _final_keys(inputs, keys)


def _is_final(inputs: Inputs, group: Group, keys: list[str]) -> bool:
    """Whether all frames of a group are there and up to date; `keys`: as for `_final_keys`."""
    pairs = zip(group.indices, _final_keys(inputs, keys), strict=True)
    since = inputs.since.get(STAGE.name, 0)
    return all(has_key(inputs.take.trained_frame(group.index, index), key, since) for index, key in pairs)


def _finished(inputs: Inputs, group: Group, recipe: Params | None = None) -> Set[int]:
    """Positions of the group's valid trained frames that need no missing one; joint training may be missing."""
    keys = frame_keys(inputs, group, recipe)
    if _is_final(inputs, group, keys):
        return set(range(len(keys)))
    found: set[int] = set()
    for position in chain([group.middle], *group.sides):
        since = inputs.since.get(STAGE.name, 0)
        valid = before_joint(inputs.take, group, group.first + position, keys[position], since) is not None
        if valid and found.issuperset(group.trained_before(position)):
            found.add(position)
    return found


def _drop_leftovers(inputs: Inputs, group: Group) -> None:
    take = inputs.take
    wanted = {take.trained_frame(group.index, index) for index in group.indices}
    if inputs.config.train.joint_iterations:
        wanted |= {take.separate_frame(group.index, index) for index in group.indices}
    folder = take.train_group(group.index)
    for path in (*folder.glob("frame_*.safetensors"), *folder.glob("separate_*.safetensors")):
        if path not in wanted:
            remove(path)
