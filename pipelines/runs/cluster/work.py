"""One stage of one group, in any process on any machine that sees the take and the footage.

The work is idempotent: it does nothing where the results are up to date, resumes from the last finished frame or
checkpoint, and gives one result if two processes get the same group. It writes no record of the stage:
`pipelines.runs.runner.run` does, which finds all groups finished and puts them together.
"""

import time

from v3studio.pipelines.config import Config
from v3studio.pipelines.events import Emit
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.runs.out_of_memory import memory_errors
from v3studio.pipelines.runs.staleness import DONE, assess_all, not_ready
from v3studio.pipelines.stages import Stage, stage_named
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.frames.groups import Group
from v3studio.pipelines.takes.results.integrity import refuse_damage
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError


def work(take: Take, config: Config, stage: str, group: int, key: str, emit: Emit, since: int = 0) -> None:
    """Do a stage of one group.

    `key`: `GroupStageCode.group_key` of the stage, as the caller knows it; `since`: of the stage, see `Inputs`. Raises
    StudioError if the stage needs another one first (`stage.dependency`), the take is not what the caller expects
    (`work.take_changed`), or for bad input.
    """
    import torch

    inputs, code = Inputs(take, config, since={stage: since}), stage_named(stage)
    torch.set_num_threads(inputs.threads)
    with disk_errors(take.root), memory_errors(stage):
        if group >= len(inputs.groups) or code.group_code.group_key(inputs, inputs.groups[group]) != key:
            problem = f"the settings, the footage or earlier results of group {group} changed after the run began"
            fix = "Run again."
            raise StudioError("work.take_changed", problem, file=take.root, fix=fix, group=group, stage=stage)
        chosen = inputs.groups[group]
        _refuse_gaps(code, inputs, chosen)
        code.make_group(inputs, chosen, StageReporter(stage, emit, Cancellation(), time.monotonic))


def _refuse_gaps(stage: Stage, inputs: Inputs, group: Group) -> None:
    """Raise StudioError if what the stage reads is missing or not up to date."""
    for name in stage.dependencies:
        before = stage_named(name)
        if before.by_group and not stage.needs_all_groups:
            if not before.group_code.group_done(inputs, group):
                raise StudioError(
                    "stage.dependency",
                    f"group {group.index} has no results of the stage {name} that are up to date",
                    file=inputs.take.root,
                    fix="Run again.",
                    stage=stage.name,
                    dependency=name,
                    group=group.index,
                )
        else:
            status = assess_all(inputs, until=before)[name]
            if status.state != DONE:
                raise not_ready(stage, status)
    if "calibrate" in stage.dependencies:
        refuse_damage(inputs.take, "calibrate")
