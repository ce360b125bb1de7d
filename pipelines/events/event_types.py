"""What a run tells while it goes: typed events, one JSON object a line with `--json`.

The command line shows them as progress bars; the window reads the lines. `parse_event` is the inverse of `to_json`.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields
from typing import Any, ClassVar, TypeAlias

from studio.errors import StudioError


@dataclass(frozen=True, kw_only=True)
class Event:
    """What all events have.

    Attributes:
        stage: the stage that it is about; "" for the run as a whole.
        time: seconds since 1970.
    """

    kind: ClassVar[str] = "event"
    stage: str = ""
    time: float = field(default_factory=time.time)

    def to_json(self) -> str:
        """One line, no newline, that can be encoded as UTF-8. NaN and infinity, which JSON lacks, become null."""
        text = json.dumps({"event": self.kind, **_finite(asdict(self))}, ensure_ascii=False)
        # a file name that is not UTF-8 holds lone surrogates, which have no bytes
        return _SURROGATE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


@dataclass(frozen=True, kw_only=True)
class RunStarted(Event):
    """A run begins: `stages` will be run in this order, `done` are up to date already."""

    kind: ClassVar[str] = "run_started"
    take: str
    stages: tuple[str, ...]
    done: tuple[str, ...]
    pid: int
    version: str


@dataclass(frozen=True, kw_only=True)
class StageStarted(Event):
    """A stage begins; `reason` says why it must run ("never run", "bake.qp changed from 22 to 30")."""

    kind: ClassVar[str] = "stage_started"
    reason: str


@dataclass(frozen=True, kw_only=True)
class Progress(Event):
    """How far the stage is.

    Attributes:
        fraction: 0 to 1, of this stage.
        total_fraction: 0 to 1, of all stages of this run (an estimate).
        seconds_left: of this stage; None while nothing can be said.
        total_seconds_left: of the run; None while nothing can be said.
        label: what is being done ("group 1, frame 7: motion").
        figures: loss, psnr, splats, iteration, group, frame ... as the stage knows them.
    """

    kind: ClassVar[str] = "progress"
    fraction: float
    total_fraction: float = 0.0
    seconds_left: float | None = None
    total_seconds_left: float | None = None
    label: str = ""
    figures: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Metrics(Event):
    """Figures that are final for something: a frame that is trained, a group that is baked, an evaluation."""

    kind: ClassVar[str] = "metrics"
    values: dict[str, Any]
    group: int | None = None
    frame: int | None = None


@dataclass(frozen=True, kw_only=True)
class Preview(Event):
    """A picture to look at: `path` is a PNG file inside the take, absolute."""

    kind: ClassVar[str] = "preview"
    path: str
    caption: str
    camera: str = ""
    group: int | None = None
    frame: int | None = None
    iteration: int | None = None


@dataclass(frozen=True, kw_only=True)
class Log(Event):
    """A line for those who want to know more."""

    kind: ClassVar[str] = "log"
    message: str


@dataclass(frozen=True, kw_only=True)
class Warned(Event):
    """Something the user should look at; the run goes on."""

    kind: ClassVar[str] = "warning"
    message: str


@dataclass(frozen=True, kw_only=True)
class StageFinished(Event):
    """A stage is done; its results stand in the take."""

    kind: ClassVar[str] = "stage_finished"
    seconds: float
    summary: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class StageFailed(Event):
    """A stage ended with an error: one sentence, and the traceback where the mistake is ours."""

    kind: ClassVar[str] = "stage_failed"
    message: str
    traceback: str = ""


@dataclass(frozen=True, kw_only=True)
class RunFinished(Event):
    """The last event: `outcome` is "done", "failed" or "cancelled"."""

    kind: ClassVar[str] = "run_finished"
    outcome: str
    seconds: float
    message: str = ""


AnyEvent: TypeAlias = (
    RunStarted | StageStarted | Progress | Metrics | Preview | Log | Warned | StageFinished | StageFailed | RunFinished
)
Emit: TypeAlias = Callable[[Event], None]

_KINDS: dict[str, type[Event]] = {
    cls.kind: cls
    for cls in (
        RunStarted, StageStarted, Progress, Metrics, Preview, Log, Warned, StageFinished, StageFailed, RunFinished
    )
}  # fmt: skip


_SURROGATE = re.compile("[\ud800-\udfff]")
_START = '{"event":'
MAX_TEXT = 500
"""Characters kept of a line that is not an event."""


def parse_event(line: str) -> Event:
    """The event in one line of `--json` output. Unknown fields are passed over, so that old windows read new runs.

    Raises:
        StudioError: the line is no event.
    """
    try:
        return _event_of(json.loads(line))
    except (ValueError, RecursionError):
        raise StudioError(f"Not an event: {line[:200]!r}.") from None


def read_line(line: bytes | str) -> tuple[Event | None, str]:
    """What a line of another process's output holds: an event, text, or text with an event in it.

    Native libraries may print between events, and in front of one where they end no line. Never raises.

    Args:
        line: with or without its newline; bytes need not be UTF-8.

    Returns:
        The event or None; and the text around it, "" where there is none, cut after `MAX_TEXT` characters.
    """
    text = line.decode("utf-8", "replace") if isinstance(line, bytes) else line
    start = text.find(_START)
    event = None
    if start >= 0:
        try:
            values, end = json.JSONDecoder().raw_decode(text, start)
            event = _event_of(values)
            text = text[:start] + text[end:]
        except (ValueError, RecursionError):  # cut short, or not ours
            pass
    text = "".join(character if character.isprintable() else " " for character in text[: MAX_TEXT + 1]).strip()
    return event, text if len(text) <= MAX_TEXT else text[:MAX_TEXT] + " ..."


def _event_of(values: Any) -> Event:
    """Raises ValueError where the values are none of an event."""
    try:
        cls = _KINDS[values.pop("event")]
        known = {f.name for f in fields(cls)}
        kept: dict[str, Any] = {
            name: tuple(v) if isinstance(v, list) else v for name, v in values.items() if name in known
        }
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
