"""What the buttons of the edits do that need a dialog, and what follows a change."""

from __future__ import annotations

from functools import partial

import numpy as np

from gui.panels.numbers_dialog import ask_numbers
from gui.presenters.edits.numbers import TITLES, fields_of, with_numbers
from gui.presenters.edits.session import edits_of
from gui.shell import Shell
from pipelines.takes.edit_words import describe
from studio.edits.edit_list import EditList

_NUMBERS_OF = {
    "crop": "crop",
    "ground": "ground",
    "floaters": "floaters",
    "origin": "world",
    "up": "world",
    "scale": "world",
    "detail": "details",
}
"""What *Numbers* sets while a tool is chosen, a key of `TITLES`."""


class EditActions:
    """See the module.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._known = EditList()

    def show(self) -> None:
        """Show the edits of the take."""
        window = self._window
        window.select("review")
        window.views.edit()
        window.laid_out()

    def changed(self) -> None:
        """After undo and redo: what was selected belongs to other edits."""
        self._window.views.editor.pending = None

    def poll(self) -> bool:
        """Call at each tick; returns whether something changed."""
        window, editor = self._window, self._window.views.editor
        found = False
        if editor.refused:
            window.notices.tell(editor.refused, bad=True, topic="edits")
            editor.refused, found = "", True
        if editor.distance_asked is not None:
            start, end = editor.distance_asked
            editor.distance_asked, found = None, True
            self._ask_distance(start, end)
        asked, window.views.asked_edit = window.views.asked_edit, ""
        if asked:
            found = True
            if asked == "list":
                self._list()
            else:
                self._numbers()
        now = edits_of(window.workspace)
        if now != self._known:
            self._known, found = now, True
            window.notices.clear("edits")
            window.player.refresh()
        return found

    def _numbers(self) -> None:
        tool = self._window.views.editor.tool
        kind = _NUMBERS_OF.get(tool, "")
        if kind:
            self._ask(kind)
            return
        lines = {title: kind for kind, (title, _) in TITLES.items()}
        self._window.dialogs.choose("edit kinds", "Which numbers?", list(lines), lambda line: self._ask(lines[line]))

    def _ask(self, kind: str) -> None:
        editor = self._window.views.editor
        title, text = TITLES[kind]

        def save(texts: dict[str, str]) -> str:
            edits = with_numbers(editor.pending or editor.edits, kind, texts, editor.up)
            if isinstance(edits, str):
                return edits
            if kind == "floaters" and editor.tool == "floaters":
                editor.pending = edits  # shown before it is removed
                return ""
            if not editor.commit(edits, title.lower()):
                refused, editor.refused = editor.refused, ""
                return refused
            return ""

        ask_numbers(self._window.dialogs, title, text, fields_of(editor.pending or editor.edits, kind, editor.up), save)

    def _ask_distance(self, start: np.ndarray, end: np.ndarray) -> None:
        editor = self._window.views.editor
        apart = float(np.linalg.norm(end - start))
        now = apart * editor.edits.similarity.scale

        def save(texts: dict[str, str]) -> str:
            try:
                distance = float(texts["distance"])
            except ValueError:
                return f"'{texts['distance']}' is not a number; example: 1.83."
            if not editor.set_scale(start, end, distance):
                refused, editor.refused = editor.refused, ""
                return refused
            return ""

        ask_numbers(
            self._window.dialogs,
            "Scale",
            f"The two points are {now:.4g} apart. How far is that really?",
            [("distance", "Distance", f"{now:.4g}")],
            save,
        )

    def _list(self) -> None:
        window, editor = self._window, self._window.views.editor
        lines = {f"Remove {name}: {text}": name for name, text in describe(editor.edits).items()}

        def remove(line: str) -> None:
            editor.commit(without(editor.edits, lines[line]), f"{lines[line]} removed")

        window.dialogs.choose("edits", "Edits", list(lines), remove, answers=self._all_answers())

    def _all_answers(self) -> list[tuple[str, str, partial[bool]]]:
        editor = self._window.views.editor
        if editor.edits == EditList():
            return []
        return [("clear", "Remove all", partial(editor.commit, EditList(), "all edits removed"))]


def without(edits: EditList, name: str) -> EditList:
    """The edits without one, by its name in `describe`."""
    kind, _, number = name.partition(" ")
    return edits.without(kind, int(number) - 1 if number else None)
