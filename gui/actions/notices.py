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
                self._window.notices.tell(failure, bad=True, topic="folder")
            else:
                self._window.notices.clear("folder")

    def copy(self) -> None:
        """Copy the path of what was written, or the text of a failure."""
        notices = self._window.notices
        card = notices.card
        if card is None:
            return
        if not self._clipboard.copy(str(card.path) if card.path is not None else card.text):
            notices.tell("There is no clipboard to copy to.", bad=True, topic="copy")
            return
        notices.clear("copy")
        if not card.bad:
            notices.dismiss()
        notices.tell("Copied the path." if card.path is not None else "Copied the message.")

    def copy_table(self) -> bool:
        """Copy the table in the view; returns whether there is one."""
        view, notices = self._window.views.stage_view, self._window.notices
        if view is None or not view.table_text:
            return False
        if self._clipboard.copy(view.table_text):
            notices.clear("copy")
            notices.tell("Copied the table.")
        else:
            notices.tell("There is no clipboard to copy to.", bad=True, topic="copy")
        return True

    def dismiss(self) -> bool:
        """Remove the notice; returns whether there was one."""
        return self._window.notices.dismiss()
