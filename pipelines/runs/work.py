"""The unit of work: one stage of one group. Any number of them may run at once, in processes or on machines.

A unit reads the take's settings and the footage, and writes the group's results. It is idempotent: it does nothing
where the results are up to date, resumes from the last finished frame or checkpoint, and two units for the same group
end with one result. It writes no record of the stage: `pipelines.runs.runner.run` does, which finds all groups finished
and puts them together.
"""

import os
import time
from collections.abc import Callable, Sequence

from v3studio.pipelines.config import Config
from v3studio.pipelines.events import Emit, RunStarted, StageFinished, StageStarted
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.runs.finishing import finishing
from v3studio.pipelines.runs.out_of_memory import memory_errors
from v3studio.pipelines.runs.staleness import DONE, StageStatus, assess_all, not_ready
from v3studio.pipelines.stages import GROUP_STAGES, STAGE_NAMES, STAGES, Stage, stage_named
from v3studio.pipelines.stages.group_scheduler import threads_of_groups
from v3studio.pipelines.stages.grouping import find_motion
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.atomic_files import disk_errors
from v3studio.pipelines.takes.groups import Group
from v3studio.pipelines.takes.integrity import refuse_damage
from v3studio.pipelines.takes.take import Take
from v3studio.pipelines.version import program_version
from v3studio.studio.counts import counted
from v3studio.studio.errors import StudioError
from v3studio.studio.progress import no_progress


def work(
    take: Take,
    config: Config,
    stage: str,
    group: int,
    emit: Emit,
    *,
    cancellation: Cancellation | None = None,
    clock: Callable[[], float] = time.monotonic,
    expected: str | None = None,
) -> bool:
    """Do a stage of one group; returns whether there was something to do.

    `expected`: `GroupStageCode.group_key` of the stage, as the caller knows it. StudioError if the stage needs another
    one first (`stage.dependency`), there is no such group (`work.no_such_group`), the take is not what the caller
    expects (`work.take_changed`), or for bad input.
    """
    import torch

    inputs, code = Inputs(take, config), stage_named(stage)
    chosen = group_of(inputs, group)
    torch.set_num_threads(inputs.threads)
    with disk_errors(take.root), memory_errors(stage):
        if expected is not None and code.group_code.group_key(inputs, chosen) != expected:
            problem = f"the settings, the footage or earlier results of group {group} changed after the run began"
            fix = "Run again."
            raise StudioError("work.take_changed", problem, file=take.root, fix=fix, group=group, stage=stage)
        _refuse_gaps(code, inputs, chosen)
        reporter, told = StageReporter(stage, emit, cancellation or Cancellation(), clock), False

        def waiting() -> None:
            nonlocal told
            reporter.check()
            if not told:
                told = True
                reporter.log(f"group {group}: another process works on it; waiting")

        with take.group_locked(stage, group, waiting):
            if is_up_to_date(code, inputs, chosen):
                reporter.log(f"group {group}: {stage} is up to date")
                return False
            code.group_code.run_group(inputs, chosen, reporter)
        reporter.check()
        return True


def group_of(inputs: Inputs, index: int) -> Group:
    """The group of this number. Raises StudioError: `work.no_such_group`."""
    groups = known_groups(inputs)
    if not 0 <= index < len(groups):
        problem = f"there is no group {index}: the take has {counted(len(groups), 'group')}, numbered from 0"
        fix = f"Choose 0 to {len(groups) - 1}."
        raise StudioError("work.no_such_group", problem, file=inputs.take.root, value=index, fix=fix)
    return groups[index]


def known_groups(inputs: Inputs) -> tuple[Group, ...]:
    """The take's groups, which any machine finds if none has."""
    if inputs.take.rig.is_file():
        find_motion(inputs, no_progress)
    return inputs.groups


def cpus_of_group(stage: str, inputs: Inputs, group: int) -> int:
    """CPU threads that a group uses in a stage: as many as in a local run, which the bytes of training depend on."""
    return threads_of_groups(inputs)[group] if stage == "train" else inputs.threads


def is_up_to_date(stage: Stage, inputs: Inputs, group: Group, known: dict[str, StageStatus] | None = None) -> bool:
    """Whether a stage has nothing to do for a group. `known`: status of stages; share it while nothing is written."""
    # an evaluation that is finished keeps no results of groups
    if stage.group_code.group_done(inputs, group):
        return True
    return stage.needs_all_groups and _status(stage.name, inputs, known).state == DONE


def _refuse_gaps(stage: Stage, inputs: Inputs, group: Group) -> None:
    """Raises StudioError if what the stage reads is missing or not up to date."""
    for name in stage.dependencies:
        before = stage_named(name)
        if before.by_group and not stage.needs_all_groups:
            if not before.group_code.group_done(inputs, group):
                raise StudioError(
                    "stage.dependency",
                    f"group {group.index} has no results of the stage {name} that are up to date",
                    file=inputs.take.root,
                    fix=f"Run `v3studio work TAKE --stage {name} --group {group.index}` first.",
                    stage=stage.name,
                    dependency=name,
                    group=group.index,
                )
        elif (status := _status(name, inputs)).state != DONE:
            raise not_ready(stage, status)
    if "calibrate" in stage.dependencies:
        refuse_damage(inputs.take, "calibrate")


def _status(name: str, inputs: Inputs, known: dict[str, StageStatus] | None = None) -> StageStatus:
    """Status of a stage as a whole; later stages are not looked at."""
    return assess_all(STAGES[: STAGE_NAMES.index(name) + 1], inputs, known)[name]


_AGAIN = "Start it again anywhere to resume."


def run_work(take: Take, config: Config, stages: Sequence[str], group: int, emit: Emit) -> None:
    """Do the stages of a group and report events as a run does; see `pipelines.runs.work.work`."""
    cancellation = Cancellation()
    names = tuple(stage.name for stage in GROUP_STAGES if stage.name in stages)
    with finishing(lambda: emit, cancellation, _AGAIN) as clock:
        emit(RunStarted(take=str(take.root), stages=names, done=(), pid=os.getpid(), version=program_version()))
        for name in names:
            began = clock()
            emit(StageStarted(stage=name, reason=f"group {group}"))
            worked = work(take, config, name, group, emit, cancellation=cancellation, clock=clock)
            summary = {"group": group, "done": "now" if worked else "before"}
            emit(StageFinished(stage=name, seconds=round(clock() - began, 2), summary=summary))
