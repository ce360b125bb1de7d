"""Bakes that the take keeps: list, compare, keep."""

from pathlib import Path

from gui.drawing.palette import BAD, DIM
from gui.models.playback.other_source import OtherSource, open_other
from gui.models.take.bakes import Bakes, bake_words
from gui.models.worker import Done, LatestWorker
from gui.shell import Shell
from gui.widgets.dialogs.base import Answer, filled, in_lines
from gui.widgets.dialogs.folder import ask_path
from gui.widgets.picture import color
from pipelines.events import as_message
from pipelines.takes.kept_bakes import KeptBake

NAME = "bakes"
ROWS, MESSAGE_LINES = 8, 2

Place = tuple[Path, str, Path | None, bool]


class BakeActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        self.bakes = Bakes()
        self._opener: LatestWorker[Place, OtherSource] = LatestWorker(
            lambda place: open_other(*place), "v3studio other", self._opened
        )
        self.bakes.changed.connect(self._changed)

    def show(self) -> None:
        window, dialogs = self._window, self._window.dialogs
        take, other = window.workspace.take, window.player.other
        self.bakes.look(take)
        self._baked = take is not None and window.workspace.row("bake").state == "done"
        self._list = dialogs.list_of(ROWS, self._select)
        self._message = dialogs.label(in_lines("", MESSAGE_LINES))
        row = dialogs.row(
            ("compare", "Compare with it", self._compare),
            ("keep", "Keep the stream as...", self._ask_keep),
            ("compare_take", "Compare with another take...", self._ask_take),
        )
        words = (
            "Bakes that this take keeps. Comparing shows them with one timeline, up to four side by side."
            if other is None
            else f"Compared with: {other.label}. Side by side (S), wipe (W) and difference (D) are against it."
        )
        stop: list[Answer] = [] if other is None else [("stop", "Stop comparing", self._stop)]
        parts = [dialogs.label(words), self._list, row, self._message]
        dialogs.show(NAME, "Bakes", parts, [*stop, ("close", "Close", dialogs.close)], 150, accent="close")
        self._update()

    def _update(self) -> None:
        dialogs, bakes = self._window.dialogs, self.bakes
        dialogs.lines = [bake_words(row) for row in bakes.rows]
        self._list.set_items(filled(dialogs.lines or ["No bakes are kept."], ROWS))
        self._message.text = in_lines(bakes.message, MESSAGE_LINES)
        self._message.text_color = color(BAD if bakes.failed else DIM)
        self._enable()

    def _enable(self) -> None:
        bakes, widgets = self.bakes, self._window.dialogs.widgets
        widgets["compare"].enabled = self._selected is not None
        widgets["keep"].enabled = self._baked and not bakes.busy and not bakes.is_kept

    @property
    def _selected(self) -> KeptBake | None:
        at, rows = self._list.selected_index, self.bakes.rows
        return rows[at] if 0 <= at < len(rows) else None

    def _select(self, _label: str, twice: bool) -> None:
        if twice:
            self._compare()
        else:
            self._enable()

    def _compare(self) -> None:
        row = self._selected
        if row is not None:
            self._window.dialogs.close()
            self._open(row.take.stream, row.name, row.take.evaluation)

    def _ask_take(self) -> None:
        dialogs, opened = self._window.dialogs, self._window.player.opened
        start = opened.path.parent if opened is not None and isinstance(opened.path, Path) else Path.home()
        ask_path(dialogs, "Compare with another take", start, "take", lambda path: self._open(Path(path)), self.show)

    def _open(self, place: Path, label: str = "", evaluation: Path | None = None) -> None:
        self._window.notices.show(f"Opening {label or place} ...", topic="compare")
        opened = self._window.player.opened
        self._opener.ask((place, label, evaluation, opened is not None and opened.take is not None))

    def _stop(self) -> None:
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
        answer = ("save", "Keep", keep)
        window.dialogs.line("keep", "Keep the stream", "Name of the bake:", name, answer, cancel=self.show)

    def _changed(self) -> None:
        window = self._window
        if not self.bakes.failed:
            window.notices.clear("bakes")
        window.notices.show(self.bakes.message, bad=self.bakes.failed, topic="bakes")
        self.bakes.look(window.workspace.take)
        window.player.refresh()
        if window.dialogs.name == NAME:
            self._update()

    def _opened(self, done: Done[Place, OtherSource]) -> None:
        window = self._window
        if done.error is not None:
            window.notices.show(str(as_message(done.error)), bad=True, topic="compare")
        elif done.result is not None:
            window.select("review")
            window.notices.clear("compare")
            window.player.compare_with(done.result)
        window.changed()

    def close(self) -> None:
        self.bakes.close()
        self._opener.close()
