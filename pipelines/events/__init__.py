"""What a run reports, how it is stopped, and its clock of work."""

from pipelines.events.event_types import (
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
)

__all__ = [
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
]
