"""Typed events that commands emit, as JSON lines with `--json`; beside them, cancellation and a clock of work time.

The command line shows them as progress bars; the window reads the lines. `read_line` is the inverse of `to_json`.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, ClassVar, Self, TypeAlias

from v3studio.studio.errors import Message, StudioError
from v3studio.studio.json_types import JsonData, JsonObject


@dataclass(frozen=True, kw_only=True)
class Event:
    """Base of all events."""

    kind: ClassVar[str] = "event"
    stage: str = ""  # the stage concerned; "" for the whole run
    time: float = field(default_factory=time.time)  # seconds since 1970

    def to_json(self) -> str:
        """One line without a newline, encodable as UTF-8. NaN and infinity, which JSON does not have, become null."""
        text = json.dumps({"event": self.kind, **_finite(asdict(self))}, ensure_ascii=False)
        # file names that are not UTF-8 hold lone surrogates, which cannot be encoded
        return _SURROGATE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


@dataclass(frozen=True, kw_only=True)
class Notice(Event):
    """Base of events that carry a `studio.errors.Message`; `of` makes them."""

    message: str = ""  # the full sentence, for display
    code: str = ""  # for programs, such as "footage.no_frames"; "" if there is no error
    file: str | None = None  # the file or folder concerned; None without one
    value: JsonData = None  # the value found; None without one
    fix: str = ""  # how to fix it, as a sentence; "" if that is not known
    # more, depending on the code: camera, frame, setting, expected and others
    fields: Mapping[str, JsonData] = field(default_factory=dict)

    @classmethod
    def of(cls, what: Message | None, **own: Any) -> Self:
        """The event of a message, JSON-ready and of bounded length; `own`: the attributes that it does not fill in."""
        told = {} if what is None else what.to_dict()
        parts = {name: told.pop(name) for name in ("message", "code", "file", "value", "fix") if name in told}
        return cls(**parts, fields=told, **own)


@dataclass(frozen=True, kw_only=True)
class RunStarted(Event):
    """First event of a run."""

    kind: ClassVar[str] = "run_started"
    take: str  # the take's folder
    stages: tuple[str, ...]  # names of the stages that will run, in order
    done: tuple[str, ...]  # names of the stages that are up to date
    pid: int  # process id of the run
    version: str  # version of V3 Studio


@dataclass(frozen=True, kw_only=True)
class StageStarted(Event):
    """A stage begins."""

    kind: ClassVar[str] = "stage_started"
    reason: str  # why it runs ("not run yet", "bake.quality changed from 22 to 30")


@dataclass(frozen=True, kw_only=True)
class Progress(Event):
    """Progress of the stage and of the run."""

    kind: ClassVar[str] = "progress"
    fraction: float  # of the stage, 0 to 1
    total_fraction: float = 0.0  # of all stages of this run, 0 to 1 (an estimate)
    seconds_left: float | None = None  # of the stage; None while unknown, always in its first ten seconds
    total_seconds_left: float | None = None  # of the run; likewise
    label: str = ""  # the step in progress ("group 1, frame 7: motion")
    # depending on the stage: loss, psnr, splats, iteration, group, frame and others
    figures: Mapping[str, JsonData] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Metrics(Event):
    """Final figures of a trained frame, a baked group or an evaluation."""

    kind: ClassVar[str] = "metrics"
    values: Mapping[str, JsonData]  # the figures by name
    group: int | None = None  # number of the group, counted from 0; None for all
    frame: int | None = None  # frame number in the footage; None for all


@dataclass(frozen=True, kw_only=True)
class GroupStarted(Event):
    """A group has begun on a node, in a run on several machines."""

    kind: ClassVar[str] = "group_started"
    group: int  # number of the group, counted from 0
    node: str  # name of the node
    gpu: str = ""  # the GPUs that it uses there ("0"); "" for none
    attempt: int = 1  # counted from 1


@dataclass(frozen=True, kw_only=True)
class Preview(Event):
    """A preview image."""

    kind: ClassVar[str] = "preview"
    path: str  # a PNG file in the take, absolute
    caption: str  # what it shows
    camera: str = ""  # name of the camera that it is rendered from
    group: int | None = None  # what was being trained
    frame: int | None = None  # what was being trained
    iteration: int | None = None  # what was being trained


@dataclass(frozen=True, kw_only=True)
class Log(Event):
    """A detail: what was found in the footage, or what a stage decided."""

    kind: ClassVar[str] = "log"
    message: str  # a sentence, for display


@dataclass(frozen=True, kw_only=True)
class Serving(Event):
    """`v3studio serve` is ready."""

    kind: ClassVar[str] = "serving"
    streams: tuple[Mapping[str, str], ...]  # objects with the `folder` and `address` of a stream
    reviews: tuple[Mapping[str, str], ...]  # objects with the `folder` and `address` of a take that can be reviewed
    bases: tuple[str, ...]  # addresses of the server; the addresses above begin with the first
    local: bool  # whether only this machine can reach the server
    https: bool  # whether it encrypts
    fingerprint: str | None  # SHA-256 of the certificate; None without one


@dataclass(frozen=True, kw_only=True)
class Warned(Notice):
    """A warning; the run continues."""

    kind: ClassVar[str] = "warning"


@dataclass(frozen=True, kw_only=True)
class StageFinished(Event):
    """A stage finished and its results are in the take."""

    kind: ClassVar[str] = "stage_finished"
    seconds: float  # work time, without pauses
    summary: Mapping[str, JsonData] = field(default_factory=dict)  # the stage's main figures


@dataclass(frozen=True, kw_only=True)
class StageFailed(Notice):
    """A stage failed."""

    kind: ClassVar[str] = "stage_failed"
    traceback: str = ""  # of an unexpected error, which is a bug; "" for bad input


@dataclass(frozen=True, kw_only=True)
class Finished(Notice):
    """The last event of every command, also of one that failed."""

    kind: ClassVar[str] = "finished"
    outcome: str  # "done" (exit code 0), "failed" or "cancelled"; "failed" without a code if a check found a fault
    seconds: float  # work time, without pauses
    # what the command found or made; empty if it has nothing to say
    result: Mapping[str, JsonData] = field(default_factory=dict)


Emit: TypeAlias = Callable[[Event], None]

_EVENTS = [kind for kind in (*Event.__subclasses__(), *Notice.__subclasses__()) if kind is not Notice]
KINDS: dict[str, type[Event]] = {kind.kind: kind for kind in _EVENTS}

_SURROGATE = re.compile("[\ud800-\udfff]")
_START = '{"event":'
MAX_TEXT = 500  # characters kept of a line that is not an event


def as_message(error: BaseException) -> Message:
    """The message of a StudioError; of any other exception, one with the code `program.bug`."""
    if isinstance(error, StudioError):
        return error.message
    return Message("program.bug", f"{type(error).__name__}: {error}", fields={"exception": type(error).__name__})


def read_line(line: bytes | str) -> tuple[Event | None, str]:
    """Split a line of another process's output, with or without its newline, into an event and the text around it.
    Never raises: native libraries print between events or in front of one, without a newline or not in UTF-8. Unknown
    fields are ignored, so that an old window can follow a newer run."""
    text = line.decode("utf-8", "replace") if isinstance(line, bytes) else line
    start = text.find(_START)
    event = None
    if start >= 0:
        try:
            fields, end = json.JSONDecoder().raw_decode(text, start)
            event = _event_of(fields)
            text = text[:start] + text[end:]
        except (ValueError, RecursionError):  # truncated, nested too deeply, or not an event
            pass
    text = "".join(character if character.isprintable() else " " for character in text[: MAX_TEXT + 1]).strip()
    return event, text if len(text) <= MAX_TEXT else text[:MAX_TEXT] + " ..."


def _event_of(values: Any) -> Event:
    """Raises ValueError if the values are not those of an event."""
    try:
        cls = KINDS[values.pop("event")]
        known = {f.name for f in fields(cls)}
        kept: JsonObject = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items() if name in known}
        if issubclass(cls, Notice) and cls is not Finished:
            kept["message"]  # required
        return cls(**kept)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not an event: {error}") from None


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    if hasattr(value, "item"):  # numpy and torch scalars
        return _finite(value.item())
    return str(value)
