"""What the buttons and keys of notices do, and copying."""

from __future__ import annotations

from gui.platform.clipboard import Clipboard
from gui.platform.desktop import show_folder
from gui.shell import Shell


class NoticeKeys:
    """See the module.

    Args:
        window: the main window.
        clipboard: where copied text goes.
    """

    def __init__(self, window: Shell, clipboard: Clipboard) -> None:
        self._window, self._clipboard = window, clipboard

    def open_folder(self) -> None:
        """Show the folder of what was written."""
        card = self._window.notices.card
        if card is not None and card.path is not None:
            failure = show_folder(card.path)
            if failure:
                self._window.notices.show(failure, bad=True, topic="folder")
            else:
                self._window.notices.clear("folder")

    def copy(self) -> None:
        """Copy the path of what was written, or the text of a failure."""
        notices = self._window.notices
        card = notices.card
        if card is None:
            return
        if not self._copied(str(card.path) if card.path is not None else card.text):
            return
        if not card.bad:
            notices.dismiss()
        notices.show("Copied the path." if card.path is not None else "Copied the message.")

    def copy_table(self) -> bool:
        """Copy the table in the view; returns whether there is one."""
        view = self._window.views.stage_view
        if view is None or not view.table_text:
            return False
        if self._copied(view.table_text):
            self._window.notices.show("Copied the table.")
        return True

    def _copied(self, text: str) -> bool:
        """Whether there was a clipboard to copy to; otherwise a notice says so."""
        if self._clipboard.copy(text):
            self._window.notices.clear("copy")
            return True
        self._window.notices.show("There is no clipboard to copy to.", bad=True, topic="copy")
        return False

    def dismiss(self) -> bool:
        """Remove the notice; returns whether there was one."""
        return self._window.notices.dismiss()
