"""Bakes that the take keeps: list, compare, keep."""

from collections.abc import Callable
from pathlib import Path

from v3studio.gui.drawing.palette import BAD, DIM, State
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.other_source import OtherSource, open_other
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Answer, Dialogs, filled, in_lines
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.picture import color
from v3studio.pipelines.events import as_message
from v3studio.pipelines.takes.files.disk_errors import disk_errors
from v3studio.pipelines.takes.results.kept_bakes import KeptBake, keep_bake, kept_bakes
from v3studio.pipelines.takes.take import Take
from v3studio.studio.counts import size_words

NAME = "bakes"
ROWS, MESSAGE_LINES = 8, 2

Place = tuple[Path, str, Path | None, bool]
Kept = tuple[Take, str]


class BakeActions:
    """Lists, keeps and compares bakes. `rows`: the bakes that are kept."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, views: StageViews, dialogs: Dialogs, notices: Notices,
        changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._views = player, workspace, views
        self._dialogs, self._notices, self._changed = dialogs, notices, changed
        self.rows: list[KeptBake] = []
        self._words, self._failed = "", False
        self._opener: LatestWorker[Place, OtherSource] = LatestWorker(
            lambda place: open_other(*place), "v3studio other", self._opened
        )
        self._keeper: LatestWorker[Kept, str] = LatestWorker(_keep, "v3studio bakes", self._kept)

    def look(self) -> None:
        """Read which bakes are kept."""
        take = self._workspace.take
        try:
            self.rows = kept_bakes(take) if take is not None else []
        except OSError as error:  # one is being removed
            self._words, self._failed = str(error), True

    def show(self) -> None:
        dialogs = self._dialogs
        take, other = self._workspace.take, self._player.other
        if self._keeper.idle:  # what was said was said when the dialog was open
            self._words, self._failed = "", False
        self.look()
        self._baked = take is not None and self._workspace.row("bake").state == State.DONE
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
        dialogs = self._dialogs
        dialogs.lines = [bake_words(row) for row in self.rows]
        self._list.set_items(filled(dialogs.lines or ["No bakes are kept."], ROWS))
        self._message.text = in_lines(self._words, MESSAGE_LINES)
        self._message.text_color = color(BAD if self._failed else DIM)
        self._enable()

    def _enable(self) -> None:
        widgets = self._dialogs.widgets
        widgets["compare"].enabled = self._selected is not None
        why = "" if self._baked else "To keep the stream, run Bake first: it is not up to date."
        why = "The stream is kept already." if any(row.is_stream for row in self.rows) else why
        widgets["keep"].enabled = self._keeper.idle and not why
        if not self._words:
            self._message.text = in_lines(why, MESSAGE_LINES)

    @property
    def _selected(self) -> KeptBake | None:
        at = self._list.selected_index
        return self.rows[at] if 0 <= at < len(self.rows) else None

    def _select(self, _label: str, twice: bool) -> None:
        if twice:
            self._compare()
        else:
            self._enable()

    def _compare(self) -> None:
        row = self._selected
        if row is not None:
            self._dialogs.close()
            self._open(row.take.stream, row.name, row.take.evaluation)

    def _ask_take(self) -> None:
        dialogs, opened = self._dialogs, self._player.opened
        start = opened.path.parent if opened is not None and isinstance(opened.path, Path) else Path.home()
        ask_path(dialogs, "Compare with another take", start, "take", lambda path: self._open(Path(path)), self.show)

    def _open(self, place: Path, label: str = "", evaluation: Path | None = None) -> None:
        self._notices.show(f"Opening {label or place} ...", topic="compare")
        opened = self._player.opened
        self._opener.ask((place, label, evaluation, opened is not None and opened.take is not None))

    def _stop(self) -> None:
        self._dialogs.close()
        self._player.compare_with(None)

    def _ask_keep(self) -> None:
        take, config = self._workspace.take, self._workspace.config
        if take is None:
            return

        def keep(name: str) -> None:
            self.keep(take, name.strip())
            self.show()

        name = f"qp{config.bake.qp}" if config is not None else ""
        answer = ("save", "Keep", keep)
        self._dialogs.line("keep", "Keep the stream", "Name of the bake:", name, answer, cancel=self.show)

    def keep(self, take: Take, name: str) -> None:
        """Keep a take's bake, on a thread."""
        self._words, self._failed = "Working ...", False
        self._keeper.ask((take, name))

    def _kept(self, done: Done[Kept, str]) -> None:
        error = done.error
        self._words, self._failed = str(as_message(error) if error is not None else done.result), error is not None
        if self._notices.outcome("bakes", self._words if self._failed else ""):
            self._notices.show(self._words, topic="bakes")
        self.look()
        self._player.refresh()
        if self._dialogs.name == NAME:
            self._update()
        self._changed()

    def _opened(self, done: Done[Place, OtherSource]) -> None:
        if done.error is not None:
            self._notices.show(str(as_message(done.error)), bad=True, topic="compare")
        elif done.result is not None:
            self._views.select("review")
            if self._views.edits_take:  # a comparison is not shown over them
                self._views.choose("done")
            self._notices.clear("compare")
            self._player.compare_with(done.result)
        self._changed()


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


def _keep(asked: Kept) -> str:
    take, name = asked
    with take.locked("v3studio-gui, bakes"), disk_errors(take.root):
        return f"Kept as '{keep_bake(take, name).name}'."
