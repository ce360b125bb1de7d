"""Judges whether results of a stage are up to date: compares what they were made from with current inputs."""

import datetime
import os
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from pydantic import JsonValue

from v3studio.pipelines.config import Config
from v3studio.pipelines.events import Warned
from v3studio.pipelines.stages import STAGES, Stage
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.params import Params
from v3studio.pipelines.takes.authored.edits import PREFIX
from v3studio.pipelines.takes.files.digests import digest_of, digests_of_files
from v3studio.pipelines.takes.files.json_files import Result, cannot_read, write_model
from v3studio.pipelines.takes.results.records import (
    RecordedWarning,
    StageRecord,
    on_disk,
    read_failure,
    read_record,
    result_of,
)
from v3studio.studio.atomic_files import remove
from v3studio.studio.errors import StudioError
from v3studio.studio.json_types import JsonData
from v3studio.studio.settings import Empty, field_named, marker

EDIT_WORDS = {  # what the edits are called, by their name
    "trim": "the trim",
    "crop": "the crop box",
    "ground": "the ground plane",
    "floaters": "the limits of floaters",
    "regions": "the lasso and brush regions",
    "world": "the placement of the world",
    "details": "the marked details",
    "masks": "the clicks on masks",
}

DONE, PARTIAL, STALE, FAILED, MISSING = "done", "partial", "stale", "failed", "missing"


@dataclass(frozen=True)
class Reason:
    """A reason why results are not up to date, for example "changed from 22 to 30": the setting with this dotted name,
    or the result of this stage; without either, the words say what."""

    words: str
    setting: str = ""
    stage: str = ""

    def __str__(self) -> str:
        return f"{self.setting or (self.stage and f'the result of {self.stage}')} {self.words}".strip()


@dataclass(frozen=True)
class StageStatus:
    """Status of a stage.

    Attributes:
        stage: its name.
        state: done, partial (begun, and not finished), stale (settings or inputs have changed), failed (the last
            attempt), missing (not run yet).
        reason: why it is not done ("not run yet", "bake.quality changed from 22 to 30", "last attempt: ...");
            if it is done, "" or why that could not be checked.
        reasons: the parts of `reason`, if it was compared with the current settings and inputs.
        units_done, units, unit: finished units, all units, and their name ("frames"); 0, 0, "" if it has none.
        seconds: duration of the finished run.
        summary: main figures of the finished run.
        needs: the stages that must run first, in order.
        warnings: those about the results of the finished run.
    """

    stage: str
    state: str
    reason: str = ""
    reasons: tuple[Reason, ...] = ()
    units_done: int = 0
    units: int = 0
    unit: str = ""
    seconds: float | None = None
    summary: Mapping[str, JsonData] | None = None
    needs: tuple[str, ...] = ()
    warnings: tuple[Warned, ...] = ()


def current_params(stage: Stage, inputs: Inputs) -> Params:
    """Settings and inputs that the stage would use now. Raises StudioError: the footage cannot be read."""
    params: Params = {"version of the stage": stage.version, **stage.code.params(inputs)}
    for dependency in stage.dependencies:
        params[f"result of {dependency}"] = result_of(inputs.take, dependency)
    return params


def write_record(
    stage: Stage, inputs: Inputs, seconds: float, summary: Result, warnings: Sequence[RecordedWarning] = ()
) -> None:
    record = StageRecord(
        stage=stage.name,
        params=cast(dict[str, JsonValue], current_params(stage, inputs)),  # the same values in pydantic's words
        **on_disk(inputs.take.root, stage.code.results(inputs)),
        seconds=round(seconds, 3),
        finished=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        summary=summary.to_json(),
        warnings=tuple(warnings),
    )
    write_model(inputs.take.record(stage.name), record)
    remove(inputs.take.failure(stage.name))


def assess(stage: Stage, inputs: Inputs, upstream: dict[str, StageStatus]) -> StageStatus:
    """The status of a stage, given that of the stages it depends on. If the footage cannot be read, a finished stage
    with its files is still done, with a note in `reason`. Not so if the edits cannot: what it must be is not known."""
    record = read_record(inputs.take, stage.name)
    direct = [dependency for dependency in stage.dependencies if upstream[dependency].state != DONE]
    needed = {name for dependency in direct for name in (*upstream[dependency].needs, dependency)}
    waiting = [name for name in upstream if name in needed]
    status, reason = StageStatus(stage.name, STALE if record else MISSING, needs=tuple(waiting)), ""
    if record:
        warned = tuple(Warned(stage=stage.name, **warning.model_dump()) for warning in record.warnings)
        status = replace(status, seconds=record.seconds, summary=record.summary, warnings=warned)
    try:
        reasons = _why_not_done(stage, inputs, record, waiting)
        reason = "; ".join(map(str, reasons))
        units = stage.code.units(inputs) if reason and not waiting else None
    except StudioError as error:
        if record and not waiting and not reason and not error.code.startswith("take.edits_"):
            return replace(status, state=DONE, reason=f"not checked against the footage: {error}")
        return replace(status, reason=reason if record and reason else str(error))
    if not reason:
        return replace(status, state=DONE)
    if units is not None:
        status = replace(status, units_done=units[0], units=units[1], unit=units[2])
    failure = read_failure(inputs.take, stage.name)
    if failure:
        return replace(status, state=FAILED, reason=f"last attempt: {failure.message}")
    if record is None:
        partial = bool(status.units_done) or (not waiting and _is_begun(stage, inputs))
    else:  # if all units of a finished stage are valid, it is stale for another reason
        partial = 0 < status.units_done < status.units
    return replace(status, state=PARTIAL if partial else status.state, reason=reason, reasons=reasons)


def assess_all(inputs: Inputs, until: Stage = STAGES[-1]) -> dict[str, StageStatus]:
    """The status of the stages up to this one, in their order."""
    statuses: dict[str, StageStatus] = {}
    for stage in STAGES[: STAGES.index(until) + 1]:
        statuses[stage.name] = assess(stage, inputs, statuses)
    return statuses


def not_ready(stage: Stage, needed: StageStatus) -> StudioError:
    """The error for a stage that cannot run, because one that it depends on is not done."""
    why = f" ({needed.reason})" if needed.reason else ""
    return StudioError(
        "stage.dependency",
        f"the stage {stage.name} needs {needed.stage}, which is {needed.state}{why}",
        fix=f"Run `v3studio run --until {needed.stage}` first, or `v3studio run` for all stages.",
        stage=stage.name,
        dependency=needed.stage,
        state=needed.state,
        reason=needed.reason,
    )


def _why_not_done(stage: Stage, inputs: Inputs, record: StageRecord | None, waiting: list[str]) -> tuple[Reason, ...]:
    if record is None:
        if waiting:
            return (Reason(f"needs {', '.join(waiting)}"),)
        return (Reason("not finished; the next run resumes" if _is_begun(stage, inputs) else "not run yet"),)
    if waiting:
        return (Reason(f"{', '.join(waiting)} must run first"),)
    root, written, touched = inputs.take.root, record.written, False
    for name, size in record.files.items():
        state = _state_of(f"{root}/{name}")
        if state is None or not stat.S_ISREG(state.st_mode) or state.st_size != size:
            return (Reason(f"{name} was {'deleted' if state is None else 'modified'}"),)
        touched |= name in written and state.st_mtime_ns != written[name]
    changed = differences(record.params, current_params(stage, inputs))  # last, since the footage may be elsewhere
    if changed:
        return changed
    # with another modification time the content may still be the same, as in a copied take
    if touched and digest_of(digests_of_files(root, [root / name for name in written])) != record.result:
        return (Reason("result files were modified"),)
    return ()


def _is_begun(stage: Stage, inputs: Inputs) -> bool:
    """Return whether an earlier run has left results or checkpoints, from which the next one may resume."""
    take = inputs.take
    files = (path for path in (take.root / stage.name).rglob("*") if path.is_file())
    return take.work(stage.name).exists() or any(path.exists() for path in (*stage.code.results(inputs), *files))


def _state_of(path: str) -> os.stat_result | None:
    """The size and times of a file; None if there is none. A long take has ten thousand, hence no `Path`."""
    try:
        return os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:  # it may be there
        raise cannot_read(Path(path), error) from None


_SOURCES = ("camera file", "board footage", "tie points", "footage")
"""Sources of cameras; each has settings of its own, which are no further change."""


def differences(before: Mapping[str, object], now: Mapping[str, object]) -> tuple[Reason, ...]:
    """At most four reasons, which say what changed."""
    names = sorted(before.keys() | now.keys())
    changed = [name for name in names if digest_of(before.get(name)) != digest_of(now.get(name))]
    # What only one side depends on, such as the footage when a ladder is fine-tuned, follows from another change.
    own = [name for name in changed if name.startswith(PREFIX) or (name in before and name in now)]
    left = [name for name in _SOURCES if name in before and name not in now]
    taken = [name for name in _SOURCES if name in now and name not in before]
    if left and taken:
        return (Reason(f"the cameras come from the {taken[0]} now, not from the {left[0]}"),)
    reasons = [_difference(name, before, now) for name in own or changed]
    return tuple(reasons if len(reasons) <= 4 else [*reasons[:3], Reason(f"{len(reasons) - 3} more settings changed")])


def _difference(name: str, before: Mapping[str, object], now: Mapping[str, object]) -> Reason:
    if name.startswith("result of "):
        return Reason("changed", stage=name.removeprefix("result of "))
    if name == "cameras without calibration" and now.get(name):
        return Reason(f"{_short(now[name])} not calibrated; used since settings of cameras or masks changed")
    if name in ("footage", "camera file", "metrics"):
        return Reason(f"the {name} changed")
    if name.startswith(PREFIX):
        return Reason(_edit_change(name, before.get(name), now.get(name)))
    return Reason(f"changed from {_short(before.get(name), name)} to {_short(now.get(name), name)}", setting=name)


def _edit_change(name: str, before: object, now: object) -> str:
    """The change of an edit, as a reason for a stale result; `name`: of the parameter."""
    what = EDIT_WORDS.get(name.removeprefix(PREFIX), name)
    verb = "set" if before is None else "removed" if now is None else "changed"
    return f"{what} {'were' if what.endswith('s') else 'was'} {verb}"


def _short(value: object, setting: str = "") -> str:
    """A value in few words: that for no value, if the setting has one."""
    field = field_named(Config, setting) if value in (None, [], {}, ()) else None
    empty = marker(field, Empty) if field is not None else None
    text = empty.text if empty is not None else "null" if value is None else str(value)
    return text if len(text) <= 40 else text[:37] + "..."
