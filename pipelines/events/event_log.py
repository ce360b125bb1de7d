"""Events, one on a line: printed, or in a file that a run writes, or a task on another machine, and others follow."""

import contextlib
import os
import threading
import time
from pathlib import Path
from typing import TextIO

from v3studio.pipelines.events import Emit, Event, Finished, Progress, read_line
from v3studio.studio.process import discard

_HEAD_BYTES = 256  # what a log is known by: its first event has the time and the process of its run


class JsonLines:
    """Prints each event immediately as one line of JSON, for programs; `finished`: whether the last one was printed.

    If the reader exits (the window is closed), the work continues silently; the log of a run is in its take.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream: TextIO | None = stream
        self._lock = threading.Lock()
        self.finished = False

    def __call__(self, event: Event) -> None:
        with self._lock:
            self.finished = self.finished or isinstance(event, Finished)
            if self._stream is None:
                return
            try:
                self._stream.write(event.to_json() + "\n")
                self._stream.flush()
            except BrokenPipeError:
                discard(self._stream)
                self._stream = None


class EventLog:
    """Passes events on, and appends them to a file; progress at most every `pause` seconds, as it is most of them."""

    def __init__(self, path: Path, pause: float, emit: Emit = lambda event: None) -> None:
        self._path, self._pause, self._emit = path, pause, emit
        self._last_progress = -pause

    def __call__(self, event: Event) -> None:
        self._emit(event)
        if isinstance(event, Progress):
            if time.monotonic() - self._last_progress < self._pause:
                return
            self._last_progress = time.monotonic()
        # an unwritable log (a full disk) must not stop the work; closing the file makes the line visible on other nodes
        with contextlib.suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(event.to_json() + "\n")


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
