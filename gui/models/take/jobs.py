"""Jobs: stages run as child processes through the command line, and runs started elsewhere, which are followed.

A job's events come through its standard output. A run started elsewhere (in a terminal, or by a window since closed) is
followed through the take's log, which the runner writes.
"""

import contextlib
import os
import queue
import signal
import subprocess
import tempfile
import threading
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

import psutil

from v3studio.gui.models.loop import LOOP, Signal
from v3studio.pipelines.events import Event, Finished, Log, read_line
from v3studio.pipelines.takes.take import Take
from v3studio.studio.atomic_files import remove
from v3studio.studio.process import python_command, start

STDERR_NAME = "window_job.log"
_LONGEST_LINE = 1 << 20  # bytes; the rest of a longer line is dropped


def v3studio_command() -> list[str]:
    """Command that runs the CLI with this Python."""
    return python_command("v3studio.pipelines.cli")


class ChildProcess:
    """A child process in its own session, so that it can outlive the window. `errors`: file for its standard error.
    `tied`: give it a pipe as standard input, which ends with the window, even if that is killed.

    Signals:
        output: there are new lines, or the process has ended.
    """

    def __init__(self, command: Sequence[str], errors: Path, folder: Path, tied: bool) -> None:
        self.errors = errors
        self.output: Signal[[]] = Signal()
        self._posted = threading.Event()
        with errors.open("wb") as file:
            self._process = start(
                command,
                stdin=subprocess.PIPE if tied else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=file,
                start_new_session=True,
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
                self._put(line)
            whole = line.endswith(b"\n")
        self._put(None)

    def _put(self, line: bytes | None) -> None:
        self._lines.put(line)
        if not self._posted.is_set():
            self._posted.set()
            LOOP.post(self._notify)

    def _notify(self) -> None:
        self._posted.clear()
        self.output.emit()

    @property
    def pid(self) -> int:
        return self._process.pid

    def take_lines(self) -> list[str]:
        """New lines of standard output. Never blocks."""
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
        """Exit status, negative for a signal; None while it runs or has unread output."""
        return self._process.poll() if self._ended else None

    def last_line(self) -> str:
        """The error that ended the process: the last "error: ..." line; without one, the last line."""
        lines = [line for line in self.last_words().splitlines() if line.strip()]
        errors = [line for line in lines if line.startswith("error: ") or ": error: " in line]
        return (errors or lines or ["no error message"])[-1].strip()

    def last_words(self) -> str:
        """The end of standard error."""
        return self.errors.read_text(encoding="utf-8", errors="replace")[-4000:] if self.errors.is_file() else ""

    def cancel(self) -> None:
        """Stop the process with SIGTERM; it exits within two seconds and keeps finished work."""
        if self._process.poll() is None:
            stop_process(self._process.pid)


class Commands(ABC):
    """Runs one `v3studio` command at a time, in a scratch folder that is removed when it has ended."""

    def __init__(self) -> None:
        self._process: ChildProcess | None = None

    @property
    def running(self) -> bool:
        """Whether a command was started and has not ended."""
        return self._process is not None

    def _run(self, arguments: Sequence[str], folder: Path | None = None, tied: bool = False) -> None:
        """Run a command; `folder`: its scratch folder, if there is one already."""
        folder = folder or scratch_folder()
        self._process = ChildProcess([*v3studio_command(), *arguments], folder / "errors.txt", folder, tied)
        self._process.output.connect(self._receive)

    def _receive(self) -> None:
        process = self._process
        if process is None:
            return
        lines, error = process.take_lines(), ""
        status = process.status
        if status is not None:
            error = process.last_line().removeprefix("error: ")
            self._forget()
        self._told([event for event, _ in map(read_line, lines) if event is not None], status, error)

    @abstractmethod
    def _told(self, events: Sequence[Event], status: int | None, error: str) -> None:
        """Take new events, and the exit status with the last error; None while the command runs."""

    def stop(self) -> None:
        """End the command, if there is one."""
        if self._process is not None:
            self._process.cancel()
            self._forget()

    def _forget(self) -> None:
        assert self._process is not None
        remove(self._process.errors.parent)
        self._process = None


def scratch_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="v3studio-window-"))


class Job(ChildProcess):
    """One run of `v3studio` on a take, with arguments without `--take` and `--json`, for example ("run", "--until",
    "train"). Output other than events goes to a file in the take's private folder."""

    def __init__(self, take: Take, arguments: Sequence[str], program: Sequence[str] = ()) -> None:
        take.private.mkdir(parents=True, exist_ok=True)
        command = [*(program or v3studio_command()), *arguments, "--take", str(take.root), "--json"]
        super().__init__(command, take.private / STDERR_NAME, take.root, tied=False)
        self._reported_end = False

    def take_events(self) -> list[Event]:
        """New events; a line that is not an event becomes a `Log`. Never blocks."""
        events: list[Event] = []
        for line in self.take_lines():
            event, text = read_line(line)
            if text:
                events.append(Log(message=text))
            if event is not None:
                events.append(event)
        self._reported_end |= any(isinstance(event, Finished) for event in events)
        return events

    def crash(self) -> tuple[str, str] | None:
        """Message and end of the output if the process ended without reporting an outcome; None otherwise."""
        code = self.status
        if self._reported_end or code is None:
            return None
        tail = self.last_words()
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"The job was killed by {signal.Signals(-code).name}. Run again to continue.", tail
        return f"The job exited with status {code}: {self.last_line()}", tail


def stop_process(pid: int) -> bool:
    """Send SIGTERM to a run and resume it if suspended; False if it has ended or is another user's."""
    try:
        os.kill(pid, signal.SIGTERM)
    except OSError:
        return False
    return pause_process(pid, False)


def pause_process(pid: int, pause: bool) -> bool:
    """Suspend or resume a run and its children; False if it has ended or is another user's."""
    try:
        process = psutil.Process(pid)
        for member in (process, *process.children(recursive=True)):
            member.suspend() if pause else member.resume()
    except psutil.Error:
        return False
    return True
