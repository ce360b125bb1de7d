"""Is a stage's result up to date? Known by comparing what it was made from with what it would be made from now."""

from __future__ import annotations

import datetime
from dataclasses import dataclass, replace
from typing import Any

from pipelines.stages.base import Context, Stage
from pipelines.stages.params import Params
from pipelines.takes.atomic_files import digest_of, digest_of_files, remove, write_json
from pipelines.takes.records import read_failure, read_record, result_of
from studio.errors import StudioError

DONE, PARTIAL, STALE, FAILED, MISSING = "done", "partial", "stale", "failed", "missing"


@dataclass(frozen=True)
class StageStatus:
    """How a stage stands.

    Attributes:
        stage: its name.
        state: done, partial (some units are finished and valid), stale (made from something else than what would be
            taken now), failed (the last attempt), missing (never run).
        reason: why it is not done; "" where it is. Of a failed one what was wrong "last time: ...": it may be mended.
        units_done, units, unit: finished units, units in all, and what they are called ("frames"); 0, 0, "" if none.
        seconds: what the finished run took.
        summary: figures of the finished run.
    """

    stage: str
    state: str
    reason: str = ""
    units_done: int = 0
    units: int = 0
    unit: str = ""
    seconds: float | None = None
    summary: dict[str, Any] | None = None


def current_params(stage: Stage, context: Context) -> Params:
    """What the stage would be made from now.

    Raises:
        StudioError: the footage cannot be read.
    """
    found: Params = {"version of the stage": stage.version, **stage.params(context)}
    for dependency in stage.dependencies:
        found[f"result of {dependency}"] = result_of(context.take, dependency)
    return found


def write_record(stage: Stage, context: Context, seconds: float, summary: dict[str, Any]) -> None:
    """Note that the stage is finished: what from, what came out, how long it took."""
    files = stage.results(context)
    root = context.take.root
    write_json(
        context.take.record(stage.name),
        {
            "stage": stage.name,
            "params": current_params(stage, context),
            "result": digest_of_files(root, files),
            "files": {path.relative_to(root).as_posix(): path.stat().st_size for path in files},
            "written": {path.relative_to(root).as_posix(): path.stat().st_mtime_ns for path in files},
            "seconds": round(seconds, 3),
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "summary": summary,
        },
    )
    remove(context.take.failure(stage.name))


def assess(stage: Stage, context: Context, upstream: dict[str, StageStatus]) -> StageStatus:
    """How the stage stands, given how the stages that it needs stand.

    A footage that cannot be read leaves a finished stage done, with a remark: its results are still there.
    """
    record = read_record(context.take, stage.name)
    found = StageStatus(stage.name, STALE if record else MISSING)
    if record:
        found = replace(found, seconds=record.get("seconds"), summary=record.get("summary"))
    waiting = [dependency for dependency in stage.dependencies if upstream[dependency].state != DONE]
    try:
        reason = _why_not_done(stage, context, record, waiting)
        units = stage.units(context) if reason and not waiting else None
    except StudioError as error:
        if record and not waiting:
            return replace(found, state=DONE, reason=f"not checked against the footage: {error}")
        return replace(found, reason=str(error))
    if not reason:
        return replace(found, state=DONE)
    if units is not None:
        found = replace(found, units_done=units[0], units=units[1], unit=units[2])
    failure = read_failure(context.take, stage.name)
    if failure:
        return replace(found, state=FAILED, reason=f"last time: {failure}")
    # finished once and all units stand, but still not done: what is wrong is no unit
    partial = found.units_done and (record is None or found.units_done < found.units)
    return replace(found, state=PARTIAL if partial else found.state, reason=reason)


def assess_all(stages: tuple[Stage, ...], context: Context) -> dict[str, StageStatus]:
    """How all stages stand, in order."""
    found: dict[str, StageStatus] = {}
    for stage in stages:
        found[stage.name] = assess(stage, context, found)
    return found


def _why_not_done(stage: Stage, context: Context, record: dict[str, Any] | None, waiting: list[str]) -> str:
    if record is None:
        return "not made yet" if not waiting else f"waits for {', '.join(waiting)}"
    if waiting:
        return f"{', '.join(waiting)} must run first"
    changed = differences(record["params"], current_params(stage, context))
    if changed:
        return "; ".join(changed)
    root = context.take.root
    for name, size in record.get("files", {}).items():
        path = context.take.file(name)
        if not path.is_file() or path.stat().st_size != size:
            return f"{name} is {'not as it was written' if path.exists() else 'gone'}"
    # A file that was written to since (or copied: then its bytes are the same) is read again.
    written = record.get("written", {})
    touched = any(context.take.file(name).stat().st_mtime_ns != time for name, time in written.items())
    if touched and digest_of_files(root, [context.take.file(name) for name in written]) != record["result"]:
        return "a result's bytes are not as they were written"
    return ""


def differences(before: Params, now: Params) -> list[str]:
    """What changed, in words, at most four of them."""
    found = []
    for name in sorted(before.keys() | now.keys()):
        old, new = before.get(name), now.get(name)
        if digest_of(old) == digest_of(new):
            continue
        if name.startswith("result of "):
            found.append(f"{name.removeprefix('result of ')} gave another result")
        elif name in ("footage", "camera file"):
            found.append(f"the {name} changed")
        else:
            found.append(f"{name} changed from {_short(old)} to {_short(new)}")
    return found if len(found) <= 4 else [*found[:3], f"{len(found) - 3} more settings changed"]


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else text[:37] + "..."
