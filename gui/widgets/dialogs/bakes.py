"""The list of the bakes that a take keeps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from open3d.visualization import gui

from gui.drawing.palette import BAD, DIM
from gui.models.take.bakes import Bakes, bake_words
from gui.widgets.dialogs.base import Answer, Dialogs, broken, filled
from gui.widgets.picture import color
from pipelines.takes.kept_bakes import KeptBake

NAME = "bakes"
ROWS, MESSAGE_LINES = 8, 2


@dataclass(frozen=True)
class BakeChoices:
    """What the dialog's buttons do.

    Attributes:
        compare: compare with a kept bake.
        compare_take: choose another take or stream to compare with.
        stop: stop comparing.
        keep: keep the take's stream; asks for a name.
    """

    compare: Callable[[KeptBake], object]
    compare_take: Callable[[], None]
    stop: Callable[[], None]
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

    def show(self, compared: str, baked: bool) -> None:
        """Show the dialog.

        Args:
            compared: label of what is compared with now; "" if nothing is.
            baked: whether there is a take with a stream to keep.
        """
        dialogs, choices = self._dialogs, self._choices
        self._baked = baked
        dialogs.widgets = {}
        self._list = gui.ListView()
        self._list.set_max_visible_items(ROWS)
        self._list.set_on_selection_changed(self._select)
        self._message = dialogs.label("\n" * (MESSAGE_LINES - 1))
        row = gui.Horiz(0.4 * dialogs.em)
        for key, label, action in (
            ("compare", "Compare with it", lambda: self._of_selected(choices.compare)),
            ("keep", "Keep the stream as...", choices.keep),
            ("compare_take", "Compare with another take...", choices.compare_take),
        ):
            row.add_child(dialogs.button(key, label, action))
        words = (
            f"Compared with: {compared}. Side by side (S), wipe (W) and difference (D) are against it."
            if compared
            else "Bakes that this take keeps. Comparing shows two at once, with one timeline."
        )
        answers: list[Answer] = [("stop", "Stop comparing", choices.stop)] if compared else []
        parts = [dialogs.label(words), self._list, row, self._message]
        dialogs.show(NAME, "Bakes", parts, [*answers, ("close", "Close", dialogs.close)], 150, accent="close")
        dialogs.widgets |= {"list": self._list}
        self.update()

    def update(self) -> None:
        """Show the bakes as they are now."""
        bakes = self._bakes
        self._dialogs.lines = [bake_words(row) for row in bakes.rows]
        self._list.set_items(filled(self._dialogs.lines or ["No bakes are kept."], ROWS))
        self._enable()
        lines = broken(bakes.message).splitlines()[:MESSAGE_LINES]
        self._message.text = "\n".join(filled(lines, MESSAGE_LINES))
        self._message.text_color = color(BAD if bakes.failed else DIM)

    def _enable(self) -> None:
        bakes, selected = self._bakes, self._selected
        may = {
            "compare": selected is not None,
            "keep": self._baked and not bakes.busy and not bakes.is_kept,
        }
        for key, enabled in may.items():
            self._dialogs.widgets[key].enabled = enabled

    @property
    def _selected(self) -> KeptBake | None:
        at, rows = self._list.selected_index, self._bakes.rows
        return rows[at] if 0 <= at < len(rows) else None

    def _select(self, _label: str, twice: bool) -> None:
        if twice:
            self._of_selected(self._choices.compare)
        else:
            self._enable()

    def _of_selected(self, action: Callable[[KeptBake], object]) -> None:
        if self._selected is not None:
            action(self._selected)
