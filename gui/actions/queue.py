"""The queue of takes and its dialog."""

from collections.abc import Callable
from pathlib import Path

from v3studio.gui.drawing.palette import BAD, DIM, State
from v3studio.gui.models.take.take_queue import TakeQueue
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.widgets.dialogs.base import Dialogs, filled, in_lines
from v3studio.gui.widgets.dialogs.folder import ask_path
from v3studio.gui.widgets.picture import color

ROWS, MESSAGE_LINES = 12, 3
NAME = "queue"
EMPTY = "The queue is empty. Add the open take, or another one."
HINT = (
    "The takes run one after another, even while the window is closed.\n"
    "A failed take does not stop the next one. A take that is stopped waits again and\n"
    "continues from its last finished frame. Double-click a take to open it."
)


class QueueActions:
    """Shows and changes the queue. `open_take`: opens the folder of a take."""

    def __init__(
        self, queue: TakeQueue, workspace: Workspace, dialogs: Dialogs, open_take: Callable[[str], None]
    ) -> None:
        self.queue, self._workspace, self._dialogs, self._open = queue, workspace, dialogs, open_take
        self.queue.changed.connect(self._update)
        self._chosen: int | None = None
        self._items: list[str] = []

    def show(self) -> None:
        dialogs, queue = self._dialogs, self.queue
        self._chosen, self._items = None, []
        self._list = dialogs.list_of(ROWS, self._select)
        self._words, self._message = dialogs.label(" "), dialogs.label(in_lines("", MESSAGE_LINES))
        row = dialogs.row(
            ("add_open", "Add open take", self._add_open),
            ("add", "Add take...", self._add),
            ("up", "Move up", lambda: self._of_chosen(lambda number: queue.move(number, -1))),
            ("down", "Move down", lambda: self._of_chosen(lambda number: queue.move(number, 1))),
            ("remove", "Remove", lambda: self._of_chosen(queue.remove)),
            ("retry", "Retry", lambda: self._of_chosen(queue.retry)),
        )
        answers = [("start", "Start", queue.start), ("stop", "Stop", queue.stop), ("close", "Close", dialogs.close)]
        parts = [self._list, row, self._words, self._message, dialogs.label(HINT)]
        dialogs.show(NAME, "Queue of takes", parts, answers, 170)
        self._update()

    @property
    def shown(self) -> bool:
        """Whether the dialog is open."""
        return self._dialogs.name == NAME

    @property
    def _open_take(self) -> Path | None:
        take = self._workspace.take
        return take.root if take is not None else None

    def _update(self) -> None:
        if not self.shown:
            return
        dialogs, queue, rows = self._dialogs, self.queue, self.queue.view.rows
        items = [str(row) for row in rows]
        if items != self._items or not items:
            self._items = dialogs.lines = items
            self._list.set_items(filled(items or [EMPTY], ROWS))
        numbers = [row.number for row in rows]
        if self._chosen not in numbers:
            self._chosen = None
        at = -1 if self._chosen is None else numbers.index(self._chosen)
        if self._list.selected_index != at:
            self._list.selected_index = at
        state = None if at < 0 else rows[at].state
        may = {
            "add_open": self._open_take is not None,
            "up": state == State.WAITING,
            "down": state == State.WAITING,
            "remove": state is not None and not (state == State.RUNNING and queue.running),
            "retry": state in (State.DONE, State.FAILED),
            "start": not queue.running and any(row.state in (State.WAITING, State.RUNNING) for row in rows),
            "stop": queue.running,
        }
        for key, enabled in may.items():
            dialogs.widgets[key].enabled = enabled
        self._words.text = queue.words.splitlines()[0] if rows or queue.view.error else " "
        self._words.text_color = color(BAD if queue.view.error else DIM)
        self._message.text = in_lines(queue.message or (rows[at].words if state == State.FAILED else ""), MESSAGE_LINES)
        self._message.text_color = color(BAD)

    def _select(self, _label: str, twice: bool) -> None:
        at, rows = self._list.selected_index, self.queue.view.rows
        self._chosen = rows[at].number if 0 <= at < len(rows) else None
        if twice and self._chosen is not None:
            self._dialogs.close()
            self._open(str(rows[at].take))
        else:
            self._update()

    def _of_chosen(self, action: Callable[[int], None]) -> None:
        if self._chosen is not None:
            action(self._chosen)

    def _add_open(self) -> None:
        if self._open_take is not None:
            self.queue.add(self._open_take)

    def _add(self) -> None:
        def done(path: str) -> None:
            self.queue.add(Path(path))
            self.show()

        dialogs, rows = self._dialogs, self.queue.view.rows
        start = rows[-1].take.parent if rows else (self._open_take or dialogs.usual_folder())
        ask_path(dialogs, "Add take to the queue", start, "take", done, self.show)
