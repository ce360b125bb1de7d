"""Jobs: stages run as child processes, exactly as the command line does; and runs that others started are followed.

A job's events come through its standard output. A run that was not started here (in a terminal, or by a window that
has been closed since) is followed through the take's log, which the runner writes.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import psutil

import pipelines
from pipelines.events import Event, Log, RunFinished, read_line
from pipelines.takes.take import Take

STDERR_NAME = "window_job.log"
_LONGEST_LINE = 1 << 20  # bytes; the rest of a longer one is dropped


def v3studio_command() -> list[str]:
    """The command line, by the Python that runs the window."""
    return [sys.executable, "-m", "pipelines.cli"]


class ChildProcess:
    """A process in a session of its own, so that it can outlive the window.

    Args:
        command: program and arguments.
        errors: file for what it prints besides its standard output.
        folder: to start it in.
    """

    def __init__(self, command: Sequence[str], errors: Path, folder: Path) -> None:
        self.errors = errors
        root = str(Path(pipelines.__file__).resolve().parents[1])  # wherever the window was started from
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
        with errors.open("wb") as file:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=file,
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": path},
                cwd=folder,
            )
        self._lines: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, name="v3studio job", daemon=True)
        self._reader.start()
        self._ended = False

    def _read(self) -> None:
        assert self._process.stdout is not None
        stream, whole = self._process.stdout, True
        while line := stream.readline(_LONGEST_LINE):
            if whole:
                self._lines.put(line)
            whole = line.endswith(b"\n")
        self._lines.put(None)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """True until the process has ended and all that it said was taken by `poll`."""
        return not self._ended

    def take_lines(self) -> list[str]:
        """New lines of its standard output. Never waits."""
        lines: list[str] = []
        with contextlib.suppress(queue.Empty):
            while not self._ended:
                line = self._lines.get_nowait()
                if line is None:
                    self._process.wait()
                    self._ended = True
                    break
                lines.append(line.decode("utf-8", "replace"))
        return lines

    @property
    def status(self) -> int | None:
        """Exit status, negative for a signal; None while it runs or its output was not all taken."""
        return self._process.poll() if self._ended else None

    def last_line(self) -> str:
        """The error that ended it: its last "error: ..." line, else the last line; libraries may print after it."""
        lines = [line for line in self.last_words().splitlines() if line.strip()]
        errors = [line for line in lines if line.startswith("error: ") or ": error: " in line]
        return (errors or lines or ["no error message"])[-1].strip()

    def last_words(self) -> str:
        """The end of what it printed as errors."""
        return self.errors.read_text(encoding="utf-8", errors="replace")[-4000:] if self.errors.is_file() else ""

    def cancel(self) -> None:
        """Ask it to stop (SIGTERM); it does so within two seconds and keeps what is finished."""
        if self._process.poll() is None:
            stop_process(self._process.pid)


class Job(ChildProcess):
    """One run of `v3studio` on a take.

    Args:
        take: what it works on; what the process prints besides events goes to a file in its private folder.
        arguments: of `v3studio`, without `--take` and `--json`, for example ("run", "--until", "train").
        program: what to start; tests give their own.
    """

    def __init__(self, take: Take, arguments: Sequence[str], program: Sequence[str] = ()) -> None:
        take.private.mkdir(parents=True, exist_ok=True)
        command = [*(program or v3studio_command()), *arguments, "--take", str(take.root), "--json"]
        super().__init__(command, take.private / STDERR_NAME, take.root)
        self._told_end = False

    def poll(self) -> list[Event]:
        """New events; a line that is not an event comes as a `Log`. Never waits."""
        events: list[Event] = []
        for line in self.take_lines():
            event, text = read_line(line)
            if text:
                events.append(Log(message=text))
            if event is not None:
                events.append(event)
        self._told_end |= any(isinstance(event, RunFinished) for event in events)
        return events

    def crash(self) -> tuple[str, str] | None:
        """A sentence and the end of its output, where it ended without telling how; None else."""
        code = self.status
        if self._told_end or code is None:
            return None
        tail = self.last_words()
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"The job was ended by {signal.Signals(-code).name}; run again to go on.", tail
        return f"The job ended with status {code}: {self.last_line()}", tail


class LogFollower:
    """Reads a take's log as it grows. `poll` tells when a new run has replaced it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._inode: int | None = None
        self._offset = 0

    def poll(self) -> tuple[bool, list[Event]]:
        """(whether the log began anew, new events)."""
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
        whole = data[: data.rfind(b"\n") + 1]  # the last line may be half written
        self._offset += len(whole)
        events = []
        for line in whole.splitlines():
            event, _ = read_line(line)
            if event is not None:
                events.append(event)
        return anew, events


def stop_process(pid: int) -> bool:
    """SIGTERM to a run, which wakes it if it is paused; False where it is gone or not ours."""
    try:
        os.kill(pid, signal.SIGTERM)
    except OSError:
        return False
    return pause_process(pid, False)


def pause_process(pid: int, pause: bool) -> bool:
    """Halt a run and its children where they stand, or let them go on; False where it is gone or not ours."""
    try:
        process = psutil.Process(pid)
        for one in (process, *process.children(recursive=True)):
            one.suspend() if pause else one.resume()
    except psutil.Error:
        return False
    return True


def is_paused(pid: int) -> bool:
    """Whether a process is halted, by `pause_process` or by Ctrl-Z in a terminal."""
    try:
        return bool(psutil.Process(pid).status() == psutil.STATUS_STOPPED)
    except psutil.Error:
        return False
