"""Follows a run through the log in its take, which the runner writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pipelines.config.renamed import STAGES
from pipelines.events.event_types import Event, RunStarted, read_line


class LogFollower:
    """Reads a take's log as it grows. `poll` detects that a new run has replaced it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._inode: int | None = None
        self._offset = 0

    def poll(self) -> tuple[bool, list[Event]]:
        """Return (whether a new log has begun, new events)."""
        try:
            state = self._path.stat()
            anew = state.st_ino != self._inode or state.st_size < self._offset
            if anew:
                self._inode, self._offset = state.st_ino, 0
            if state.st_size == self._offset:
                return anew, []
            with self._path.open("rb") as file:
                file.seek(self._offset)
                data = file.read()
        except OSError:
            return False, []
        whole = data[: data.rfind(b"\n") + 1]  # the last line may be incomplete
        self._offset += len(whole)
        events = []
        for line in whole.splitlines():
            event, _ = read_line(line)
            if event is not None:
                events.append(_with_current_names(event))
        return anew, events


def _with_current_names(event: Event) -> Event:
    """Logs of format 1 takes have the old names of stages."""
    event = replace(event, stage=STAGES.get(event.stage, event.stage))
    if isinstance(event, RunStarted):
        event = replace(
            event,
            stages=tuple(STAGES.get(stage, stage) for stage in event.stages),
            done=tuple(STAGES.get(stage, stage) for stage in event.done),
        )
    return event
