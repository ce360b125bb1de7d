"""The work on a take's groups as commands for the queue that a studio has: Slurm, OpenCue, Deadline, GNU parallel."""

import shlex
from collections.abc import Sequence

from v3studio.pipelines.config import Config
from v3studio.pipelines.config.loading import parse_override
from v3studio.pipelines.runs.staleness import StageStatus
from v3studio.pipelines.runs.work import cpus_of_group, is_up_to_date, known_groups
from v3studio.pipelines.stages import GROUP_STAGES
from v3studio.pipelines.stages.group_scheduler import groups_at_once
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import StudioError


def printed_commands(take: Take, config: Config, stages: Sequence[str], form: str, overrides: Sequence[str]) -> str:
    """The text that `v3studio work --print-commands` prints.

    The commands name the CPU threads of a group, because the bytes of training depend on them, and on another machine
    they would be others.

    Args:
        form: plain is one command a line, as GNU parallel and OpenCue's cuecmd take them; deadline is the same for
            Deadline's plugin CommandScript; sbatch is a Slurm batch file with an array of tasks.
        overrides: settings of `config` that are not in the take's config.yaml, as "train.max_splats=5000". The
            commands name them, since they read that file.

    Raises:
        StudioError: the footage cannot be read, or a word cannot be quoted for Deadline (`work.cannot_quote`).
    """
    inputs = Inputs(take, config)
    groups = known_groups(inputs)
    chosen = [stage for stage in GROUP_STAGES if stage.name in stages]
    known: dict[str, StageStatus] = {}
    todo = [group.index for group in groups if not all(is_up_to_date(stage, inputs, group, known) for stage in chosen)]
    if not todo:
        return ""
    command = _command(take, inputs, [stage.name for stage in chosen], overrides)
    if form == "sbatch":
        longest = "train" if "train" in stages else chosen[0].name
        # one number for all tasks: groups of the last round have more threads (`threads_by_group`)
        cpus = max(cpus_of_group(longest, inputs, group) for group in todo)
        return _sbatch(take, command, todo, cpus, gpu=config.run.device not in ("auto", "cpu"))
    if form == "deadline":
        command = _double_quoted(command)
    return "".join(f"{command} --group {group}\n" for group in todo)


def _double_quoted(command: str) -> str:
    """The same command for Deadline, which starts it without a shell and knows double quotes only."""
    words = shlex.split(command)
    for word in words:
        if set(word) & set('"\\$`\n'):
            problem = f"'{word}' cannot be part of a command for Deadline"
            fix = 'Use paths and settings without ", \\, $ and `.'
            raise StudioError("work.cannot_quote", problem, value=word, fix=fix)
    return " ".join(word if shlex.quote(word) == word else f'"{word}"' for word in words)


def _command(take: Take, inputs: Inputs, stages: Sequence[str], overrides: Sequence[str]) -> str:
    words = ["v3studio", "work", str(take.root)]
    for stage in stages:
        words += ["--stage", stage]
    for override in overrides:
        name, _ = parse_override(override)
        if name == "capture.root":  # it is relative to the folder where this command runs
            words.append(f"--set=capture.root={inputs.config.capture.root}")
        elif name not in ("run.threads", "run.groups_at_once"):
            words.append(f"--set={override}")
    words += ["--run.threads", str(inputs.threads), "--run.groups_at_once", str(groups_at_once(inputs))]
    return shlex.join(words)


def _sbatch(take: Take, command: str, todo: Sequence[int], cpus: int, gpu: bool) -> str:
    folder = str(take.private).replace("%", "%%")  # Slurm replaces %a and others
    lines = [
        "#!/bin/bash",
        f"#SBATCH --job-name={shlex.quote(f'v3studio {take.root.name}')}",
        f"#SBATCH --array={ranges(todo)}",
        "#SBATCH --ntasks=1",
        f"#SBATCH --cpus-per-task={cpus}",
        *(["#SBATCH --gpus-per-task=1"] if gpu else []),
        "#SBATCH --requeue",
        "#SBATCH --open-mode=append",
        f"#SBATCH --output={shlex.quote(f'{folder}/slurm_%a.log')}",
        f"exec {command} --group $SLURM_ARRAY_TASK_ID",
    ]
    return "\n".join(lines) + "\n"


def ranges(numbers: Sequence[int]) -> str:
    """Ascending numbers as Slurm writes them: 0-3,7."""
    found: list[list[int]] = []
    for number in numbers:
        if found and number == found[-1][1] + 1:
            found[-1][1] = number
        else:
            found.append([number, number])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in found)
