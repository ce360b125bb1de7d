"""Bakes that the take keeps: list, compare, keep."""

from __future__ import annotations

from pathlib import Path

from gui.models.playback.other_source import OtherSource, open_other
from gui.models.take.bakes import Bakes
from gui.models.worker import Done, LatestWorker
from gui.shell import Shell
from gui.widgets.dialogs.bakes import NAME, BakeChoices, BakesDialog
from gui.widgets.dialogs.folder import ask_path
from pipelines.takes.kept_bakes import KeptBake
from studio.errors import StudioError

Place = tuple[Path, str, Path | None, bool]


class BakeActions:
    """See the module.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window
        self.bakes = Bakes()
        self._opener: LatestWorker[Place, OtherSource] = LatestWorker(
            lambda place: open_other(*place), "v3studio other", self._opened
        )
        self.bakes.changed.connect(self._changed)
        choices = BakeChoices(self._compare, self._ask_take, self.stop, self._ask_keep)
        self._dialog = BakesDialog(window.dialogs, self.bakes, choices)

    def show(self) -> None:
        """Show the dialog."""
        window = self._window
        take = window.workspace.take
        self.bakes.look(take)
        other = window.player.other
        baked = take is not None and window.workspace.row("bake").state == "done"
        self._dialog.show(other.label if other is not None else "", baked)

    def _compare(self, row: KeptBake) -> None:
        self._window.dialogs.close()
        self._open(row.take.stream, row.name, row.take.evaluation)

    def _ask_take(self) -> None:
        opened = self._window.player.opened
        start = opened.path.parent if opened is not None and isinstance(opened.path, Path) else Path.home()
        dialogs = self._window.dialogs
        ask_path(dialogs, "Compare with take or stream", start, "take", lambda path: self._open(Path(path)), self.show)

    def _open(self, place: Path, label: str = "", evaluation: Path | None = None) -> None:
        self._window.notices.show(f"Opening {label or place} ...", topic="compare")
        opened = self._window.player.opened
        self._opener.ask((place, label, evaluation, opened is not None and opened.take is not None))

    def stop(self) -> None:
        """Stop comparing with another bake or take."""
        self._window.dialogs.close()
        self._window.player.compare_with(None)

    def _ask_keep(self) -> None:
        window = self._window
        take, config = window.workspace.take, window.workspace.config
        if take is None:
            return

        def keep(name: str) -> None:
            self.bakes.keep(take, name.strip())
            self.show()

        name = f"qp{config.bake.qp}" if config is not None else ""
        window.dialogs.line(
            "keep", "Keep the stream", "Name of the bake:", name,
            [("save", "Keep", keep), ("close", "Cancel", lambda _: self.show())],
        )  # fmt: skip

    def _changed(self) -> None:
        window = self._window
        if not self.bakes.failed:
            window.notices.clear("bakes")
        window.notices.show(self.bakes.message, bad=self.bakes.failed, topic="bakes")
        self.bakes.look(window.workspace.take)
        window.player.refresh()
        if window.dialogs.name == NAME:
            self._dialog.update()

    def _opened(self, done: Done[Place, OtherSource]) -> None:
        window = self._window
        if done.result is None:
            known = isinstance(done.error, StudioError)
            words = str(done.error) if known else f"It cannot be opened: {done.error!r}"
            window.notices.show(words, bad=True, topic="compare")
        else:
            window.select("review")
            window.notices.clear("compare")
            window.player.compare_with(done.result)
        window.changed()

    def close(self) -> None:
        """End the threads."""
        self.bakes.close()
        self._opener.close()
