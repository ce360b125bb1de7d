"""The queue of takes: shows its dialog and keeps it up to date."""

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
        self._dialog: QueueDialog | None = None
        self._shown: object = None

    def show(self) -> None:
        """Show the queue."""
        window = self._window
        take = window.workspace.take
        opening = Opening(take.root if take is not None else None, window.open)
        self._dialog = QueueDialog(window.dialogs, self.queue, opening)
        self._dialog.show()
        self._shown = self.queue.state

    def poll(self) -> bool:
        """Call at each tick; returns whether something changed."""
        if self._dialog is None or self._window.dialogs.name != NAME:
            return False
        self.queue.poll()
        if self.queue.state == self._shown:  # what it shows: the start page polls too
            return False
        self._shown = self.queue.state
        self._dialog.update()
        return True

    def close(self) -> None:
        """End the thread; the queue goes on."""
        self.queue.close()
