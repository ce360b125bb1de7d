"""`v3studio estimate`: how long a run will take, and how much memory and disk it needs."""

from __future__ import annotations

import argparse
import os
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from v3studio.pipelines.commands.common.arguments import add_command
from v3studio.pipelines.commands.common.source import add_source, is_take, read_settings
from v3studio.pipelines.commands.common.working import working
from v3studio.pipelines.reports.terminal import console, duration, table_of
from v3studio.studio.counts import counted, size_words
from v3studio.studio.errors import StudioError
from v3studio.studio.memory import require_memory
from v3studio.studio.process import keep_freed_memory

if TYPE_CHECKING:
    from v3studio.pipelines.estimate.estimate import Estimate
    from v3studio.pipelines.stages.inputs import Inputs

_NOTE = """Reads some images of the footage and rehearses some steps of training, about 20 seconds on an idle machine.
Nothing is written. The cameras must be known, by a file or by a take whose stage calibrate is finished; the time of
the calibration itself is not estimated. Times assume the current load of the machine.
"""


def register(commands: Any) -> None:
    parser = add_command(
        commands,
        "estimate",
        "estimate minutes, memory and disk space of a run on this machine",
        _estimate,
        epilog=_NOTE,
    )
    add_source(parser)
    parser.add_argument(
        "--presets", action="store_true", help="estimate the presets preview, standard and final too; about a minute"
    )


def _estimate(arguments: argparse.Namespace) -> None:
    require_memory()  # both as a run does
    keep_freed_memory()
    from v3studio.pipelines.config.presets import PRESETS, with_values
    from v3studio.pipelines.stages.inputs import Inputs

    presets: dict[str, Estimate] = {}
    with ExitStack() as stack:
        inputs = _inputs(arguments, stack)
        now = os.getloadavg()[0]  # programs that wanted a core in the last minute, this one included
        estimate = _rehearsed(inputs, "rehearsal", arguments)
        if arguments.presets:
            for name, settings in PRESETS.items():
                others = Inputs(inputs.take, with_values(inputs.config, settings))
                presets[name] = _rehearsed(others, f"rehearsal of the preset {name}", arguments)
    more = {"presets": {name: preset.to_json() for name, preset in presets.items()}} if presets else {}
    arguments.result = {**estimate.to_json(), "load": now, **more}
    if not arguments.json:
        _print(estimate, inputs.threads, now)
        for name, preset in presets.items():
            stream = next((stage.bytes for stage in preset.stages if stage.stage == "bake"), None)
            words = "" if stream is None else f", a stream of about {size_words(stream)}"
            console().print(f"preset {name}: about {duration(preset.seconds)}{words}")


def _rehearsed(inputs: Inputs, title: str, arguments: argparse.Namespace) -> Estimate:
    """The estimate of a take whose cameras are known."""
    from v3studio.pipelines.estimate.estimate import estimate
    from v3studio.pipelines.estimate.rehearsal import rehearse
    from v3studio.pipelines.estimate.work import Work

    bake = inputs.config.bake
    known = not bake.ladder and isinstance(bake.quality, int)
    qp = bake.qp if known else None
    work = Work.of(inputs)
    with working(title, arguments) as progress:
        return estimate(work, rehearse(inputs, work, progress), qp)


def _inputs(arguments: argparse.Namespace, stack: ExitStack) -> Inputs:
    """The inputs of a take whose cameras are known: the given one, or a temporary one with cameras from a file."""
    from v3studio.pipelines.runs.runner import run
    from v3studio.pipelines.stages.inputs import Inputs
    from v3studio.pipelines.takes.take import Take

    source = arguments.source
    config = read_settings(source, arguments.overrides)
    if is_take(source) and Take.open(source).rig.is_file():
        return Inputs(Take.open(source), config)
    take = Take.create(Path(stack.enter_context(tempfile.TemporaryDirectory())) / "take")
    inputs = Inputs(take, config)
    from v3studio.pipelines.stages.calibrate_plan import CalibratePlan

    if CalibratePlan(inputs).source != "file":
        calibrate = f"v3studio calibrate {source}" if is_take(source) else f"v3studio calibrate {source} --take DIR"
        problem = "the cameras are not known yet, and training cannot be rehearsed without them"
        raise StudioError("estimate.no_cameras", problem, fix=f"Run `{calibrate}` first, then estimate the take.")
    run(take, config, lambda event: None, stages=["calibrate"], command="v3studio estimate")
    return inputs


def _print(estimate: Estimate, threads: int, now: float) -> None:
    from v3studio.pipelines.estimate.estimate import STREAM_SPREAD

    screen, table = console(), table_of("stage", "time", "memory", "disk", "", left=(0, 4))
    for stage in estimate.stages:
        disk = "" if stage.bytes is None else size_words(stage.bytes)
        if stage.stage == "bake" and stage.bytes is not None:
            disk = f"{size_words(stage.bytes / STREAM_SPREAD)} to {size_words(stage.bytes * STREAM_SPREAD)}"
        table.add_row(
            stage.stage,
            "" if stage.seconds is None else duration(stage.seconds),
            "" if stage.memory is None else size_words(stage.memory),
            disk,
            stage.remark,
        )
    screen.print(table)
    low, high = estimate.range
    screen.print(
        f"About {duration(estimate.seconds)}, most likely {duration(low)} to {duration(high)}; "
        f"{counted(estimate.splats, 'splat')} per frame; up to {size_words(estimate.memory)} of memory"
    )
    if now > 0.5 * threads:
        screen.print(
            f"Other programs are running (load {now:.1f}, {threads} threads): without them, the run takes less time."
        )
