"""The bakes that a take keeps: what the window lists, and keeps on a thread."""

from gui.models.loop import Signal
from gui.models.worker import Done, LatestWorker
from pipelines.takes.atomic_files import disk_errors
from pipelines.takes.kept_bakes import KeptBake, keep_bake, kept_bakes
from pipelines.takes.take import Take
from studio.counts import size_words
from studio.errors import StudioError

Kept = tuple[Take, str]


def bake_words(kept: KeptBake) -> str:
    """A kept bake in one line."""
    parts = [
        kept.name,
        f"quality {kept.quality}",
        f"{size_words(kept.summary.bytes_per_frame)} per frame",
        size_words(kept.bytes),
        "not evaluated" if kept.psnr is None else f"{kept.psnr:.2f} dB",
        "the take's stream" if kept.is_stream else "",
        "" if kept.current else "older training",
        "" if kept.same_edits else "other edits",
        "other settings" if kept.other_settings else "",
    ]
    return "    ".join(filter(None, parts))


class Bakes:
    """See the module. Nothing here blocks, except for listing, which reads small files."""

    def __init__(self) -> None:
        self._worker: LatestWorker[Kept, str] = LatestWorker(_keep, "v3studio bakes", self._made)
        self.changed: Signal[[]] = Signal()
        self.rows: list[KeptBake] = []
        self.message, self.failed = "", False

    @property
    def busy(self) -> bool:
        return not self._worker.idle

    @property
    def is_kept(self) -> bool:
        """Whether the take's stream is one of the kept bakes."""
        return any(row.is_stream for row in self.rows)

    def look(self, take: Take | None) -> None:
        try:
            self.rows = kept_bakes(take) if take is not None else []
        except OSError as error:  # one is being removed
            self.message, self.failed = str(error), True

    def keep(self, take: Take, name: str) -> None:
        self.message, self.failed = "Working ...", False
        self._worker.ask((take, name))

    def _made(self, done: Done[Kept, str]) -> None:
        self.failed = done.error is not None
        known = done.error is None or isinstance(done.error, StudioError)
        self.message = str(done.error or done.result) if known else f"It failed: {done.error!r}"
        self.changed.emit()

    def close(self) -> bool:
        """End the thread after a bake that is being kept. Returns whether it ended in time."""
        return self._worker.close()


def _keep(asked: Kept) -> str:
    take, name = asked
    with take.locked("v3studio-gui, bakes"), disk_errors(take.root):
        return f"Kept as '{keep_bake(take, name).name}'."
