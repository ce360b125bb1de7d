"""The queue of takes: shows its dialog and keeps it current."""

from __future__ import annotations

from gui.models.take.take_queue import TakeQueue
from gui.shell import Shell
from gui.widgets.dialogs.queue import NAME, Opening, QueueDialog


class QueueActions:
    """See the module.

    Args:
        window: the main window.

    Attributes:
        queue: the queue.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window
        self.queue = TakeQueue()
        self.queue.watched = lambda: self._shown or window.start.shown
        self.queue.changed.connect(self._update)
        self._dialog: QueueDialog | None = None

    def show(self) -> None:
        """Show the queue."""
        window = self._window
        take = window.workspace.take
        opening = Opening(take.root if take is not None else None, window.open)
        self._dialog = QueueDialog(window.dialogs, self.queue, opening)
        self._dialog.show()

    @property
    def _shown(self) -> bool:
        return self._dialog is not None and self._window.dialogs.name == NAME

    def _update(self) -> None:
        if self._dialog is not None and self._shown:
            self._dialog.update()

    def close(self) -> None:
        """End the thread; the queue keeps running."""
        self.queue.close()
