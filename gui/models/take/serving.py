"""Serving the open take to phones: `v3studio serve` as a child process that ends with the window."""

from collections.abc import Sequence

from v3studio.gui.models.loop import Signal
from v3studio.gui.models.take.jobs import Commands
from v3studio.pipelines.events import Event
from v3studio.pipelines.events import Serving as ServingEvent


class Serving(Commands):
    """One server at a time. `fingerprint`: SHA-256 of its certificate; "" over http.

    Signals:
        started: the address is known.
        failed: the server has ended before it was stopped, for this reason.
    """

    def __init__(self) -> None:
        super().__init__()
        self.source = self.address = self.fingerprint = ""
        self.started: Signal[[]] = Signal()
        self.failed: Signal[[str]] = Signal()

    @property
    def words(self) -> str:
        """The words in the status line; "" if nothing is served."""
        return f"serving at {self.address}" if self.address else "serving: starting" if self.running else ""

    def start(self, source: str, https: bool) -> None:
        """Serve a folder on all interfaces, at any free port, instead of the present one."""
        self.stop()
        options = ["--host", "0.0.0.0", "--port", "0", "--json", "--end-with-stdin", *["--https"] * https]
        self._run(["serve", source, *options], tied=True)
        self.source = source

    def _told(self, events: Sequence[Event], status: int | None, error: str) -> None:
        if status is not None:
            self.failed.emit(f"Serving has ended: {error}")
            return
        before = self.address
        for event in events:
            if isinstance(event, ServingEvent) and event.streams:
                self.address = event.streams[0]["address"]
                self.fingerprint = event.fingerprint or ""
        if self.address != before:
            self.started.emit()

    def _forget(self) -> None:
        super()._forget()
        self.source = self.address = self.fingerprint = ""
