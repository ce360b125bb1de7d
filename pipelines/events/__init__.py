"""What a run reports, how it is stopped, and its clock of work."""

from pipelines.events.event_types import (
    MAX_TEXT,
    AnyEvent,
    Emit,
    Event,
    Log,
    Metrics,
    Preview,
    Progress,
    RunFinished,
    RunStarted,
    StageFailed,
    StageFinished,
    StageStarted,
    Warned,
    parse_event,
    read_line,
)

__all__ = [
    "MAX_TEXT",
    "AnyEvent",
    "Emit",
    "Event",
    "Log",
    "Metrics",
    "Preview",
    "Progress",
    "RunFinished",
    "RunStarted",
    "StageFailed",
    "StageFinished",
    "StageStarted",
    "Warned",
    "parse_event",
    "read_line",
]
