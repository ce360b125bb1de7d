"""The queue of takes, kept in a file that several programs read and change."""

import contextlib
import os
import signal
import socket
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.files.json_files import Result, read_model, write_model
from v3studio.pipelines.takes.files.locks import exclusively, held, holder_of
from v3studio.studio.errors import StudioError
from v3studio.studio.storage.address import is_address

State = Literal["waiting", "running", "done", "failed"]


class QueuedTake(Result):
    """A take in the queue."""

    number: Annotated[int, Field(ge=1)]  # never given to another take of the same queue
    take: Path  # folder of the take, absolute
    config: Path | None = None  # YAML file of settings, absolute; None: those in the take
    overrides: tuple[str, ...] = ()  # settings that come on top: SECTION.NAME=VALUE
    folder: Path  # working directory when it was added; relative paths in `overrides` start there
    state: State = "waiting"  # failed: see `message`. A take that was interrupted waits again
    message: str = ""  # why it failed, or what it achieved
    added: str  # date and time, ISO 8601 in UTC
    started: str = ""  # of the last run; empty before the first
    finished: str = ""  # of the last run that ended


class Queue(Result):
    """All takes, in the order in which they are run."""

    format: Literal[1]  # version of this file
    last_number: Annotated[int, Field(ge=0)] = 0  # the largest number that was ever given
    takes: tuple[QueuedTake, ...] = ()  # takes that wait, run or have ended


def now() -> str:
    """Date and time in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def default_queue() -> Path:
    """The user's queue: $XDG_STATE_HOME/v3studio/queue.json, normally in ~/.local/state (XDG base directories)."""
    state = os.environ.get("XDG_STATE_HOME", "")
    folder = Path(state) if Path(state).is_absolute() else Path.home() / ".local" / "state"
    return folder / "v3studio" / "queue.json"


class QueueFile:
    """Reads and changes the queue, a JSON file. Each change is made under a lock and written at once."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> Queue:
        """The queue; empty if there is no file. Raises StudioError: not a queue (`take.damaged`)."""
        try:
            return read_model(self.path, Queue)
        except StudioError as error:
            if error.code == "take.file_not_found":
                return Queue(format=1)
            fix = "Choose another file with --queue, or move this one away."
            raise StudioError(error.code, error.problem, file=error.file, fix=fix) from None

    @contextlib.contextmanager
    def _changing(self) -> Iterator[list[QueuedTake]]:
        """The takes, for the block to change, which are written at its end. Raises StudioError: `take.*`."""
        with disk_errors(self.path.parent):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with exclusively(self._lock("lock")):
                queue = self.read()
                takes = list(queue.takes)
                yield takes
                last = max([queue.last_number, *(entry.number for entry in takes)])
                changed = {"format": 1, "last_number": last, "takes": tuple(takes)}
                write_model(self.path, queue.model_copy(update=changed))

    def add(self, take: Path, config: Path | None, overrides: tuple[str, ...]) -> QueuedTake:
        """Add a take at the end; paths may be relative."""
        with self._changing() as takes:
            for other in takes:
                if other.take == take.absolute() and other.state in ("waiting", "running"):
                    problem = f"the take is in the queue already, with number {other.number}"
                    fix = f"To change its settings, first run `v3studio queue remove {other.number}`."
                    raise StudioError("queue.duplicate", problem, file=take, value=other.number, fix=fix)
            entry = QueuedTake(
                number=self.read().last_number + 1,
                take=take.absolute(),
                config=config if config is None or is_address(config) else config.absolute(),
                overrides=overrides,
                folder=Path.cwd(),
                state="waiting",
                added=now(),
            )
            takes.append(entry)
        return entry

    def replace(self, number: int, **changes: object) -> None:
        """Change values of a take; nothing happens if it was removed."""
        with self._changing() as takes:
            takes[:] = [entry.model_copy(update=changes) if entry.number == number else entry for entry in takes]

    def remove(self, number: int) -> QueuedTake:
        """Take an entry out of the queue; the take's folder is not touched. Raises StudioError: `queue.*`."""
        with self._changing() as takes:
            entry = _entry(takes, number)
            if entry.state == "running" and self.is_run():
                fix = "First run `v3studio queue stop`."
                raise StudioError("queue.running", f"take {number} is running", value=number, fix=fix)
            takes.remove(entry)
        return entry

    def move(self, number: int, place: int) -> None:
        """Move a take to a place among those that wait, counted from 1. Raises StudioError: `queue.*`."""
        with self._changing() as takes:
            entry = _entry(takes, number)
            if entry.state != "waiting":
                problem = f"take {number} is {entry.state}; only takes that wait can be moved"
                fix = "`v3studio queue list` shows the states."
                raise StudioError("queue.not_waiting", problem, value=number, fix=fix)
            takes.remove(entry)
            waiting = [index for index, other in enumerate(takes) if other.state == "waiting"]
            before = max(place, 1) - 1
            takes.insert(waiting[before] if before < len(waiting) else len(takes), entry)

    def retry(self, number: int) -> None:
        """Let a take that has ended wait again, at the end of the queue. Raises StudioError: `queue.*`."""
        with self._changing() as takes:
            entry = _entry(takes, number)
            if entry.state not in ("done", "failed"):
                problem = f"take {number} is {entry.state}"
                raise StudioError("queue.not_ended", problem, value=number, fix="It needs no retry.")
            takes.remove(entry)
            takes.append(entry.model_copy(update={"state": "waiting", "message": ""}))

    def claim(self) -> QueuedTake | None:
        """The next take that waits, which now counts as running; None if there is none."""
        with self._changing() as takes:
            for index, entry in enumerate(takes):
                if entry.state == "waiting":
                    takes[index] = entry.model_copy(update={"state": "running", "started": now(), "message": ""})
                    return takes[index]
        return None

    def is_run(self) -> bool:
        with contextlib.suppress(OSError):
            return holder_of(self._lock("run")) is not None
        return False

    def stop(self) -> int:
        """Stop the program that works through the queue, and return its process ID; its take waits again."""
        holder = holder_of(self._lock("run"), anywhere=True)
        if holder is None:
            fix = "`v3studio queue run` starts it."
            raise StudioError("queue.not_run", "the queue is not running", file=self.path, fix=fix)
        if not {"pid", "host"} <= holder.keys():
            problem = "a program that is starting or ending works through the queue"
            fix = "Try again in a moment, or press Ctrl+C where it was started."
            raise StudioError("queue.unknown_runner", problem, file=self.path, fix=fix)
        pid, host = int(holder["pid"]), holder["host"]
        try:
            if host != socket.gethostname():
                raise PermissionError
            os.kill(pid, signal.SIGTERM)
        except OSError:
            problem = f"process {pid} on {host} works through the queue and cannot be stopped from here"
            fix = "Stop it on that machine, as the user who started it."
            raise StudioError("queue.cannot_stop", problem, file=self.path, fix=fix) from None
        return pid

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Hold the queue for the program that works through it. Takes that another program left running wait again."""
        with disk_errors(self.path.parent):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._lock("run").touch()
        problem, fix = "another program works through this queue", "`v3studio queue list` shows its progress."
        with held(self._lock("run"), lambda holder: StudioError("queue.already_run", problem, file=self.path, fix=fix)):
            with self._changing() as takes:
                waiting = {"state": "waiting"}
                takes[:] = [entry.model_copy(update=waiting) if entry.state == "running" else entry for entry in takes]
            yield

    def _lock(self, name: str) -> Path:
        return self.path.with_name(f".{self.path.name}.{name}")


def _entry(takes: Sequence[QueuedTake], number: int) -> QueuedTake:
    for entry in takes:
        if entry.number == number:
            return entry
    known = ", ".join(str(entry.number) for entry in takes[:20])
    fix = f"It has {known}." if known else "It is empty."
    raise StudioError("queue.unknown", f"the queue has no take with number {number}", value=number, fix=fix)
