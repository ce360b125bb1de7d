"""The dialog with the queue of takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from open3d.visualization import gui

from gui.drawing.palette import BAD, DIM
from gui.models.take.take_queue import TakeQueue
from gui.widgets.dialogs.base import Dialogs, broken, filled
from gui.widgets.dialogs.folder import ask_path
from gui.widgets.picture import color

ROWS, MESSAGE_LINES = 12, 3
NAME = "queue"
EMPTY = "The queue is empty. Add the open take, or another one."


@dataclass(frozen=True)
class Opening:
    """How the dialog opens takes.

    Attributes:
        current: folder of the open take; None if none is open.
        open: opens one.
    """

    current: Path | None
    open: Callable[[str], None]


class QueueDialog:
    """See the module.

    Args:
        dialogs: shows it.
        queue: what it shows and changes.
        opening: how it opens takes.
    """

    def __init__(self, dialogs: Dialogs, queue: TakeQueue, opening: Opening) -> None:
        self._dialogs, self._queue, self._opening = dialogs, queue, opening
        self._chosen: int | None = None
        self._items: list[str] = []

    def show(self) -> None:
        """Show the dialog."""
        dialogs, queue = self._dialogs, self._queue
        dialogs.widgets = {}
        self._list = gui.ListView()
        self._list.set_max_visible_items(ROWS)
        self._list.set_on_selection_changed(self._select)
        self._items = []
        self._words, self._message = dialogs.label(" "), dialogs.label("\n" * (MESSAGE_LINES - 1))
        row = gui.Horiz(0.4 * dialogs.em)
        for key, label, action in (
            ("add_open", "Add open take", self._add_open),
            ("add", "Add take...", self._add),
            ("up", "Move up", lambda: self._of_chosen(lambda number: queue.move(number, -1))),
            ("down", "Move down", lambda: self._of_chosen(lambda number: queue.move(number, 1))),
            ("remove", "Remove", lambda: self._of_chosen(queue.remove)),
            ("retry", "Retry", lambda: self._of_chosen(queue.retry)),
        ):
            row.add_child(dialogs.button(key, label, action))
        hint = dialogs.label(
            "The takes run one after the other, also when the window is closed.\n"
            "A failed take does not stop the next one. A take that is stopped waits again and\n"
            "continues from its last finished frame. Double-click a take to open it."
        )
        answers = [("start", "Start", queue.start), ("stop", "Stop", queue.stop), ("close", "Close", dialogs.close)]
        dialogs.show(NAME, "Queue of takes", [self._list, row, self._words, self._message, hint], answers, 170)
        dialogs.widgets |= {"list": self._list}
        self.update()

    def update(self) -> None:
        """Show the queue as it is now. Call whenever it has changed."""
        queue, rows = self._queue, self._queue.view.rows
        items = [str(row) for row in rows]
        if items != self._items or not items:
            self._items = self._dialogs.lines = items
            self._list.set_items(filled(items or [EMPTY], ROWS))
        numbers = [row.number for row in rows]
        if self._chosen not in numbers:
            self._chosen = None
        at = -1 if self._chosen is None else numbers.index(self._chosen)
        if self._list.selected_index != at:
            self._list.selected_index = at
        state = "" if at < 0 else rows[at].state
        may = {
            "add_open": self._opening.current is not None,
            "up": state == "waiting",
            "down": state == "waiting",
            "remove": state != "" and not (state == "running" and queue.running),
            "retry": state in ("done", "failed"),
            "start": not queue.running and any(row.state in ("waiting", "running") for row in rows),
            "stop": queue.running,
        }
        for key, enabled in may.items():
            self._dialogs.widgets[key].enabled = enabled
        self._words.text = queue.words.splitlines()[0] if rows or queue.view.error else " "
        self._words.text_color = color(BAD if queue.view.error else DIM)
        failure = rows[at].words if state == "failed" else ""
        lines = broken(queue.message or failure).splitlines()[:MESSAGE_LINES]
        self._message.text = "\n".join(filled(lines, MESSAGE_LINES))
        self._message.text_color = color(BAD)

    def _select(self, _label: str, twice: bool) -> None:
        at, rows = self._list.selected_index, self._queue.view.rows
        self._chosen = rows[at].number if 0 <= at < len(rows) else None
        if twice and self._chosen is not None:
            self._dialogs.close()
            self._opening.open(str(rows[at].take))
        else:
            self.update()

    def _of_chosen(self, action: Callable[[int], None]) -> None:
        if self._chosen is not None:
            action(self._chosen)

    def _add_open(self) -> None:
        if self._opening.current is not None:
            self._queue.add(self._opening.current)

    def _add(self) -> None:
        def done(path: str) -> None:
            self._queue.add(Path(path))
            self.show()

        rows = self._queue.view.rows
        start = rows[-1].take.parent if rows else (self._opening.current or self._dialogs.usual_folder())
        ask_path(self._dialogs, "Add take to the queue", start, "take", done, self.show)
