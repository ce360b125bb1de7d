"""The bakes that a take keeps under names: what the window lists, and changes on a thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gui.models.loop import Signal
from gui.models.worker import Done, LatestWorker
from pipelines.takes.atomic_files import disk_errors
from pipelines.takes.kept_bakes import KeptBake, choose_bake, keep_bake, kept_bakes, remove_bake
from pipelines.takes.take import Take
from studio.errors import StudioError

Change = Callable[[], str]


@dataclass(frozen=True)
class BakeRow:
    """A kept bake as listed.

    Attributes:
        name: its name.
        stream, evaluation: what is compared.
        frees: bytes that are free after it is deleted.
        chosen: whether it is the take's stream.
        words: the row's text.
    """

    name: str
    stream: Path
    evaluation: Path
    frees: int
    chosen: bool
    words: str

    @classmethod
    def of(cls, kept: KeptBake) -> BakeRow:
        """The row of a kept bake."""
        psnr = kept.psnr
        parts = [
            kept.name,
            kept.quality,
            f"{kept.bytes_per_frame / 1000:.1f} KB/frame",
            f"{kept.bytes / 1e6:.2f} MB",
            "not evaluated" if psnr is None else f"{psnr:.2f} dB",
            "the take's stream" if kept.chosen else "",
            "" if kept.current else "older training",
            "" if kept.same_edits else "other edits",
        ]
        words = "    ".join(filter(None, parts))
        return cls(kept.name, kept.take.stream, kept.take.evaluation, kept.frees, kept.chosen, words)


class Bakes:
    """See the module. Nothing here blocks, except for listing, which reads small files.

    Attributes:
        rows: the kept bakes of the take.
        message: what happened last.
        failed: whether it was refused.
        changed: emitted when a change has been made or refused.
    """

    def __init__(self) -> None:
        self._worker: LatestWorker[Change, str] = LatestWorker(lambda change: change(), "v3studio bakes", self._made)
        self.changed: Signal[[]] = Signal()
        self.rows: list[BakeRow] = []
        self.message, self.failed = "", False

    @property
    def busy(self) -> bool:
        """Whether a change is being made."""
        return not self._worker.idle

    def look(self, take: Take) -> None:
        """List the kept bakes."""
        try:
            self.rows = [BakeRow.of(kept) for kept in kept_bakes(take)]
        except OSError as error:  # one is being removed
            self.message, self.failed = str(error), True

    def row(self, name: str) -> BakeRow | None:
        """The row of a name; None if there is none."""
        return next((row for row in self.rows if row.name == name), None)

    @property
    def chosen(self) -> BakeRow | None:
        """The kept bake that is the take's stream; None if the stream is not kept."""
        return next((row for row in self.rows if row.chosen), None)

    def keep(self, take: Take, name: str) -> None:
        """Keep the take's stream under a name."""

        def change() -> str:
            return f"Kept as '{keep_bake(take, name).name}'."

        self._change(take, change)

    def choose(self, take: Take, name: str, discard: bool = False) -> None:
        """Make a kept bake the take's stream; `discard` the present one if it is not kept."""

        def change() -> str:
            kept = choose_bake(take, name, discard=discard)
            return " ".join([f"'{kept.name}' is the take's stream now, with its settings.", *kept.remarks])

        self._change(take, change)

    def remove(self, take: Take, name: str) -> None:
        """Delete a kept bake."""
        self._change(take, lambda: f"'{name}' is deleted: {remove_bake(take, name) / 1e6:.2f} MB are free again.")

    def _change(self, take: Take, change: Change) -> None:
        if self.busy:
            self.message, self.failed = "Another change is being made. Try again in a moment.", True
            return

        def locked() -> str:
            with take.locked("v3studio-gui, bakes"), disk_errors(take.root):
                return change()

        self.message, self.failed = "Working ...", False
        self._worker.ask(locked)

    def _made(self, done: Done[Change, str]) -> None:
        self.failed = done.error is not None
        if isinstance(done.error, StudioError) or done.error is None:
            self.message = str(done.error or done.result)
        else:
            self.message = f"It failed: {done.error!r}"
        self.changed.emit()

    def close(self) -> bool:
        """End the thread after a change in progress. Returns whether it ended in time."""
        return self._worker.close()
