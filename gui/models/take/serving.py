"""Serving the open take to phones: `v3studio serve` as a child process that ends with the window."""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from gui.models.loop import Signal
from gui.models.take.jobs import ChildProcess, v3studio_command
from pipelines.events import Serving as ServingEvent
from pipelines.events import read_line
from pipelines.takes.atomic_files import remove


@dataclass
class Serving:
    """One server at a time. `fingerprint`: SHA-256 of its certificate; "" over http. `started` is emitted when the
    address is known, `failed` with the reason if the server ends before it is stopped."""

    source: str = ""
    address: str = ""
    fingerprint: str = ""
    started: Signal[[]] = field(default_factory=Signal)
    failed: Signal[[str]] = field(default_factory=Signal)
    _process: ChildProcess | None = None

    @property
    def running(self) -> bool:
        """Whether it was started and has not ended."""
        return self._process is not None

    @property
    def words(self) -> str:
        """For the status line; "" if nothing is served."""
        return f"serving at {self.address}" if self.address else "serving: starting" if self.running else ""

    def start(self, source: str, https: bool) -> None:
        """Serve a folder on all interfaces, at any free port, in place of what is served."""
        self.stop()
        scratch = Path(tempfile.mkdtemp(prefix="v3studio-serve-"))
        options = ["--host", "0.0.0.0", "--port", "0", "--json", "--end-with-stdin", *["--https"] * https]
        command = [*v3studio_command(), "serve", source, *options]
        self._process = ChildProcess(command, scratch / "errors.txt", scratch, tied=True)
        self._process.output.connect(self._receive)
        self.source = source

    def _receive(self) -> None:
        process = self._process
        if process is None:
            return
        before = self.address
        for line in process.take_lines():
            event, _ = read_line(line)
            if isinstance(event, ServingEvent) and event.streams:
                self.address = event.streams[0]["address"]
                self.fingerprint = event.fingerprint or ""
        if process.status is not None:
            why = f"Serving has ended: {process.last_line().removeprefix('error: ')}"
            self._forget()
            self.failed.emit(why)
        elif self.address != before:
            self.started.emit()

    def stop(self) -> None:
        """End the server, if there is one."""
        if self._process is not None:
            self._process.cancel()
            self._forget()

    def _forget(self) -> None:
        assert self._process is not None
        remove(self._process.errors.parent)
        self._process = None
        self.source = self.address = self.fingerprint = ""
