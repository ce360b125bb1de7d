"""The dialog with the bakes that a take keeps under names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from open3d.visualization import gui

from gui.drawing.palette import BAD, DIM
from gui.models.take.bakes import BakeRow, Bakes
from gui.widgets.dialogs.base import Answer, Dialogs, broken, filled
from gui.widgets.picture import color

NAME = "bakes"
ROWS, MESSAGE_LINES = 8, 2


@dataclass(frozen=True)
class BakeChoices:
    """What the dialog's buttons do.

    Attributes:
        compare: compare with a kept bake.
        compare_take: choose another take or stream to compare with.
        stop: stop comparing.
        choose: make it the take's stream.
        remove: delete it.
        keep: keep the take's stream; asks for a name.
    """

    compare: Callable[[BakeRow], object]
    compare_take: Callable[[], None]
    stop: Callable[[], None]
    choose: Callable[[BakeRow], object]
    remove: Callable[[BakeRow], object]
    keep: Callable[[], None]


class BakesDialog:
    """See the module.

    Args:
        dialogs: shows it.
        bakes: what it shows.
        choices: what its buttons do.
    """

    def __init__(self, dialogs: Dialogs, bakes: Bakes, choices: BakeChoices) -> None:
        self._dialogs, self._bakes, self._choices = dialogs, bakes, choices
        self._chosen = ""
        self._items: list[str] = []

    def show(self, compared: str, has_take: bool, baked: bool) -> None:
        """Show the dialog.

        Args:
            compared: label of what is compared with now; "" if nothing is.
            has_take: whether a take is open; a bare stream keeps no bakes.
            baked: whether it has a stream to keep.
        """
        dialogs, choices = self._dialogs, self._choices
        self._has_take, self._baked = has_take, baked
        dialogs.widgets = {}
        self._list = gui.ListView()
        self._list.set_max_visible_items(ROWS)
        self._list.set_on_selection_changed(self._select)
        self._items = []
        self._message = dialogs.label("\n" * (MESSAGE_LINES - 1))
        row = gui.Horiz(0.4 * dialogs.em)
        for key, label, action in (
            ("compare", "Compare with it", lambda: self._of_chosen(choices.compare)),
            ("choose", "Make it the stream", lambda: self._of_chosen(choices.choose)),
            ("remove", "Delete...", lambda: self._of_chosen(choices.remove)),
            ("keep", "Keep the stream as...", choices.keep),
            ("compare_take", "Compare with another take...", choices.compare_take),
        ):
            row.add_child(dialogs.button(key, label, action))
        words = (
            f"Compared with: {compared}. Side by side (S), wipe (W) and difference (D) are against it."
            if compared
            else "Bakes of this take, kept under names. Comparing shows two at once, with one timeline."
        )
        answers: list[Answer] = [("stop", "Stop comparing", choices.stop)] if compared else []
        dialogs.show(
            NAME,
            "Bakes",
            [dialogs.label(words), self._list, row, self._message],
            [*answers, ("close", "Close", dialogs.close)],
            150,
            accent="close",
        )
        dialogs.widgets |= {"list": self._list}
        self.update()

    def update(self) -> None:
        """Show the bakes as they are now."""
        rows = self._bakes.rows
        items = [row.words for row in rows]
        if items != self._items or not items:
            self._items = self._dialogs.lines = items
            shown = items or ["No bakes are kept." if self._has_take else "A stream keeps no bakes. Open its take."]
            self._list.set_items(filled(shown, ROWS))
        names = [row.name for row in rows]
        at = names.index(self._chosen) if self._chosen in names else -1
        if self._list.selected_index != at:
            self._list.selected_index = at
        free = at >= 0 and not self._bakes.busy
        may = {
            "compare": at >= 0,
            "choose": free and not rows[at].chosen,
            "remove": free,
            "keep": self._baked and not self._bakes.busy and self._bakes.chosen is None,
        }
        for key, enabled in may.items():
            self._dialogs.widgets[key].enabled = enabled
        lines = broken(self._bakes.message).splitlines()[:MESSAGE_LINES]
        self._message.text = "\n".join(filled(lines, MESSAGE_LINES))
        self._message.text_color = color(BAD if self._bakes.failed else DIM)

    def _select(self, _label: str, twice: bool) -> None:
        at, rows = self._list.selected_index, self._bakes.rows
        self._chosen = rows[at].name if 0 <= at < len(rows) else ""
        if twice:
            self._of_chosen(self._choices.compare)
        else:
            self.update()

    def _of_chosen(self, action: Callable[[BakeRow], object]) -> None:
        row = self._bakes.row(self._chosen)
        if row is not None:
            action(row)
