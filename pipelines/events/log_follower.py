"""Follows a run through the log in its take, which the runner writes."""

from __future__ import annotations

import os
from pathlib import Path

from pipelines.events import Event, read_line

_HEAD_BYTES = 256
"""What a log is known by: its first event has the time and the process of its run."""


class LogFollower:
    """Reads a take's log as it grows. `poll` detects that a new run has replaced it, also by a log of the same size and
    inode: file systems use inodes again."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._inode: int | None = None
        self._seen: tuple[int, int, int] | None = None
        self._head = b""
        self._offset = 0

    def poll(self) -> tuple[bool, list[Event]]:
        """Return (whether a new log has begun, new events)."""
        try:
            # opened first: on a network file system, this brings size and time of a file up to date
            with self._path.open("rb") as file:
                state = os.fstat(file.fileno())
                seen = (state.st_ino, state.st_mtime_ns, state.st_size)
                if seen == self._seen:
                    return False, []
                head = file.read(_HEAD_BYTES)
                is_new = state.st_ino != self._inode or not head.startswith(self._head)
                if is_new:
                    self._inode, self._head, self._offset = state.st_ino, b"", 0
                file.seek(self._offset)
                data = file.read()
        except OSError:
            return False, []
        self._seen = seen
        whole = data[: data.rfind(b"\n") + 1]  # the last line may be incomplete
        if self._offset == 0:
            self._head = whole[:_HEAD_BYTES]
        self._offset += len(whole)
        events = []
        for line in whole.splitlines():
            event, _ = read_line(line)
            if event is not None:
                events.append(event)
        return is_new, events
