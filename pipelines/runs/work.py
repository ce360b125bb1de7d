"""The unit of work: one stage of one group. Any number of them may run at once, in processes or on machines.

A unit reads the take's settings and the footage, and writes the group's results. It is idempotent: it does nothing
where the results are up to date, goes on from the last finished frame or checkpoint, and two units for the same group
end with one result. It writes no record of the stage: `pipelines.runs.runner.run` does, which finds all groups finished
and puts them together.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from pipelines.config import Config
from pipelines.events import Emit
from pipelines.events.cancellation import Cancellation
from pipelines.runs.out_of_memory import memory_errors
from pipelines.runs.staleness import DONE, StageStatus, assess
from pipelines.stages import GROUP_STAGES, grouping, stage_named
from pipelines.stages.base import Context, GroupStage, StageReporter
from pipelines.stages.group_scheduler import threads_of_groups
from pipelines.takes.atomic_files import disk_errors
from pipelines.takes.groups import Group
from pipelines.takes.integrity import refuse_damage
from pipelines.takes.take import Take
from studio.counts import counted
from studio.errors import StudioError


def work(
    take: Take,
    config: Config,
    stages: Sequence[str],
    group: int,
    emit: Emit,
    *,
    cancellation: Cancellation | None = None,
    clock: Callable[[], float] = time.monotonic,
    expected: str | None = None,
) -> tuple[str, ...]:
    """Do these stages of one group, in the order of a run.

    Args:
        take: the take. It is not locked, only the group is.
        config: its settings.
        stages: names from `work_choices.GROUP_STAGE_NAMES`.
        group: number of the group, counted from 0.
        emit: receives the events of the stages' work.
        cancellation: set it from another thread to cancel.
        clock: work time in seconds.
        expected: `GroupStage.group_key` of the only stage, as the caller knows it.

    Returns:
        names of the stages that had something to do.

    Raises:
        StudioError: the stage needs another one first (`stage.dependency`), there is no such group
            (`work.no_such_group`), the take is not what the caller expects (`work.take_changed`), or bad input.
        Cancelled: it was cancelled.
    """
    context = Context(take, config, emit, cancellation or Cancellation(), clock)
    chosen = group_of(context, group)
    limit_threads(context.threads)
    done = []
    with disk_errors(take.root):
        for stage in (stage for stage in GROUP_STAGES if stage.name in stages):
            if expected is not None and stage.group_key(context, chosen) != expected:
                raise StudioError(
                    "work.take_changed",
                    f"the settings, the footage or earlier results of group {group} changed after the run began",
                    file=take.root,
                    fix="Run again.",
                    group=group,
                    stage=stage.name,
                )
            with memory_errors(stage.name):
                worked = _work_on(stage, context, chosen)
            if worked:
                done.append(stage.name)
    return tuple(done)


def group_of(context: Context, index: int) -> Group:
    """The group of this number.

    Raises:
        StudioError: there is none (`work.no_such_group`), or where groups begin is not known yet
            (`work.groups_unknown`).
    """
    groups = known_groups(context)
    if not 0 <= index < len(groups):
        raise StudioError(
            "work.no_such_group",
            f"there is no group {index}: the take has {counted(len(groups), 'group')}, numbered from 0",
            file=context.take.root,
            value=index,
            fix=f"Choose 0 to {len(groups) - 1}.",
        )
    return groups[index]


def known_groups(context: Context) -> tuple[Group, ...]:
    """The take's groups.

    Raises:
        StudioError: where groups begin is not known yet (`work.groups_unknown`).
    """
    if not grouping.is_known(context.footage):
        raise StudioError(
            "work.groups_unknown",
            "where groups begin is not known yet (train.grouping is motion)",
            file=context.take.root,
            fix="Run `v3studio initialize` first.",
            setting="train.grouping",
        )
    return context.groups


def cpus_of_group(stage: str, context: Context, group: int) -> int:
    """CPU threads that a group uses in a stage: as many as in a local run, which the bytes of training depend on."""
    return threads_of_groups(context)[group] if stage == "train" else context.threads


def is_up_to_date(
    stage: GroupStage, context: Context, group: Group, known: dict[str, StageStatus] | None = None
) -> bool:
    """Whether a stage has nothing to do for a group.

    Args:
        stage: the stage.
        context: of the take.
        group: the group.
        known: status of whole stages, which is filled in; share it between groups only while nothing is written.
    """
    # an evaluation that is finished keeps no results of groups
    return stage.group_done(context, group) or (stage.name == "evaluate" and _state(stage.name, context, known) == DONE)


def limit_threads(threads: int) -> None:
    """Set the number of CPU threads of torch and of the kernels in this process."""
    import torch

    torch.set_num_threads(threads)


def _work_on(stage: GroupStage, context: Context, group: Group) -> bool:
    """Whether there was something to do."""
    _refuse_gaps(stage, context, group)
    reporter = StageReporter(stage.name, context)
    told = False

    def waiting() -> None:
        nonlocal told
        context.cancellation.check()
        if not told:
            told = True
            reporter.log(f"group {group.index}: another process works on it; waiting")

    with context.take.group_locked(stage.name, group.index, waiting):
        if is_up_to_date(stage, context, group):
            reporter.log(f"group {group.index}: {stage.name} is up to date")
            return False
        stage.run_group(context, group, reporter)
    context.cancellation.check()
    return True


def _refuse_gaps(stage: GroupStage, context: Context, group: Group) -> None:
    """Raises StudioError if what the stage reads is missing or not up to date."""
    for name in stage.dependencies:
        before = next((one for one in GROUP_STAGES if one.name == name), None)
        if before is not None and stage.name != "evaluate":
            if not before.group_done(context, group):
                raise StudioError(
                    "stage.dependency",
                    f"group {group.index} has no results of the stage {name} that are up to date",
                    file=context.take.root,
                    fix=f"Run `v3studio work TAKE --stage {name} --group {group.index}` first.",
                    stage=stage.name,
                    dependency=name,
                    group=group.index,
                )
        elif (state := _state(name, context)) != DONE:
            raise StudioError(
                "stage.dependency",
                f"the stage {stage.name} needs {name}, which is {state}",
                file=context.take.root,
                fix=f"Run `v3studio run --until {name}` first, or `v3studio run` for all stages.",
                stage=stage.name,
                dependency=name,
                state=state,
            )
    if "calibrate" in stage.dependencies:
        refuse_damage(context.take, "calibrate")


def _state(name: str, context: Context, known: dict[str, StageStatus] | None = None) -> str:
    """State of a stage as a whole; only stages that it depends on are looked at."""
    known = {} if known is None else known
    if name not in known:
        stage = stage_named(name)
        for dependency in stage.dependencies:
            _state(dependency, context, known)
        known[name] = assess(stage, context, known)
    return known[name].state
