"""A notice over the lower edge of the view, with buttons for what follows."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from open3d.visualization import gui

from v3studio.gui.drawing.canvas import shortened
from v3studio.gui.drawing.palette import ACCENT_DARK, BAD, TEXT
from v3studio.gui.models.notices import Notice, Notices
from v3studio.gui.platform.clipboard import Clipboard
from v3studio.gui.platform.desktop import Opener
from v3studio.gui.widgets.picture import color, make_button, make_card, make_label

WIDEST, MOST_LINES = 48.0, 12  # width of the bar in em, and lines of a message


class NoticeBar:
    """Shows the notice in front, with its buttons."""

    def __init__(self, notices: Notices, em: float, clipboard: Clipboard, changed: Callable[[], None]) -> None:
        self._notices, self._em, self._clipboard, self._changed = notices, em, clipboard, changed
        self._opener = Opener()
        self.buttons: dict[str, gui.Button] = {}
        self._shown: object = None
        self.widget, self._content = make_card(em)

    def update(self, room: float, hidden: bool) -> bool:
        """Show the notice; returns whether anything changed, which needs a layout. `hidden`: something else needs the
        place; a failure is shown nevertheless."""
        failure = self._opener.failure()
        if failure:
            self._notices.show(failure, bad=True, topic="desktop")
        card = self._notices.card
        if card is not None and hidden and not card.bad:
            card = None
        width = min(WIDEST * self._em, room - 2 * self._em)
        state = (card, self._notices.more, width) if card is not None else None
        if state == self._shown:
            return False
        self._shown, self.buttons = state, {}
        self.widget.visible = card is not None
        if card is not None:
            self._content.set_widget(self._filled(card, width))
        return True

    def _filled(self, card: Notice, width: float) -> gui.Widget:
        em = self._em
        column = gui.Vert(round(0.5 * em))
        rest = "... (Copy message has the rest)"
        lines = shortened(card.text, round(em), width - 1.6 * em, MOST_LINES, rest)
        column.add_child(make_label("\n".join(lines), BAD if card.bad else TEXT))
        row = gui.Horiz(round(0.5 * em))
        if card.path is not None:
            page = card.path if card.path.suffix == ".html" else None
            if page is not None:
                self._button(row, "open_page", "Open in browser", partial(self._open, page), True)
            self._button(row, "open_folder", "Open folder (Ctrl+O)", self.open_folder, page is None)
            self._button(row, "copy", "Copy path (Ctrl+C)", self.copy)
        else:
            self._button(row, "copy", "Copy message (Ctrl+C)", self.copy)
        more = self._notices.more
        self._button(row, "dismiss", f"Dismiss (Esc){f', {more} more' if more else ''}", self._notices.dismiss)
        column.add_child(row)
        return column

    def _open(self, path: Path) -> None:
        with self._notices.reporting("desktop"):
            self._opener.open(path)

    def open_folder(self) -> None:
        """Open the folder of the file that was written."""
        card = self._notices.card
        if card is not None and card.path is not None:
            self._open(card.path if card.path.is_dir() else card.path.parent)

    def copy(self) -> None:
        """Copy the path of the file that was written, or the text of a failure."""
        card = self._notices.card
        if card is None or not self.copied(str(card.path) if card.path is not None else card.text):
            return
        if not card.bad:
            self._notices.dismiss()
        self._notices.show("Copied the path." if card.path is not None else "Copied the message.")

    def copied(self, text: str) -> bool:
        """Copy a text; returns whether there was a clipboard to copy to. Otherwise a notice says so."""
        done = self._clipboard.copy(text)
        return self._notices.outcome("copy", "" if done else "There is no clipboard to copy to.")

    def _button(self, row: gui.Horiz, key: str, label: str, action: Callable[[], object], accent: bool = False) -> None:
        button = self.buttons[key] = make_button(label, action, self._changed)
        if accent:
            button.background_color = color(ACCENT_DARK)
        row.add_child(button)

    def place(self, context: gui.LayoutContext, x: float, y: float, width: float, height: float) -> None:
        """Place it at the lower edge of the view, whose rectangle is given in window pixels."""
        if not self.widget.visible:
            return
        wanted = self.widget.calc_preferred_size(context, gui.Widget.Constraints())
        wide = min(wanted.width, width)
        high = min(wanted.height, height)
        top = y + height - high - 0.8 * self._em
        self.widget.frame = gui.Rect(int(x + (width - wide) / 2), int(max(top, y)), int(wide), int(high))
