"""What the buttons of the edits do that need a dialog, and what follows a change."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from open3d.visualization import gui

from v3studio.gui.models.loop import later
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.pages.review.numbers import TITLES, fields_of, with_numbers
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.dialogs.form import ask_numbers
from v3studio.gui.widgets.picture import holds
from v3studio.pipelines.takes.authored.edits import describe, singular
from v3studio.pipelines.takes.frames.edited import newly_removed
from v3studio.pipelines.takes.take import Take
from v3studio.studio.counts import counted
from v3studio.studio.edits.edit_list import EditList
from v3studio.studio.errors import Cancelled

REMOVED = (
    "A splat is removed from all frames of its group. In other groups, those are\n"
    "removed that are inside the region in at least half of the frames."
)

Removal = tuple[Take, EditList, dict[str, EditList]]
"""The take, its edits without a removal, and with it by the words of a choice."""

_NUMBERS_OF = {"origin": "world", "up": "world", "scale": "world", "detail": "details"}
"""What *Numbers* sets while a tool is chosen, a key of `TITLES`, where the tool has another name."""


class EditActions:
    """See the module; it acts through the main window."""

    def __init__(self, window: Shell) -> None:
        self._window = window
        self._known = EditList()
        self._counter: LatestWorker[Removal, list[int]] = LatestWorker(self._count, "v3studio count", self._counted)
        self._removal: Removal | None = None
        views, notices = window.views, window.notices
        views.edit_dialog.connect(later(lambda key: self._list() if key == "list" else self._numbers()))
        views.editor.two_points.connect(later(self._ask_distance))
        views.editor.range_wanted.connect(later(self._ask_range))
        views.editor.refusal.connect(partial(notices.show, bad=True, topic="edits"))
        window.workspace.changed.connect(self._follow_edits)

    def show(self) -> None:
        window = self._window
        window.views.select("review")
        window.views.edit()
        window.window.set_needs_layout()

    def moved(self) -> None:
        """The pointer has moved: the brush follows it."""
        editor = self._window.views.editor
        editor.pointer = self._pointer() if editor.tool == "brush" else None

    def _follow_edits(self) -> None:
        now = self._window.views.editor.edits
        if now != self._known:
            self._known = now
            self._window.notices.clear("edits")
            self._window.player.refresh()

    def keys(self) -> dict[Any, Callable[[], object]]:
        """Key bindings while the brush is chosen."""
        key, editor = gui.KeyName, self._window.views.editor
        if not self._window.views.edits_take or editor.tool != "brush":
            return {}
        smaller, larger = partial(editor.step_brush, -1), partial(editor.step_brush, 1)
        return {key.MINUS: smaller, key.PLUS: larger, key.EQUALS: larger}  # + is Shift and = on many keyboards

    def _pointer(self) -> tuple[float, float] | None:
        """Where the pointer is over the view, relative to its width and height; None elsewhere."""
        window = self._window
        at, view = window.input.pointer, window.viewport.picture.widget
        if at is None or window.dialogs.name or window.start.shown or not holds(view, *at) or window.over_view(*at):
            return None
        return (at[0] - view.frame.x) / view.frame.width, (at[1] - view.frame.y) / view.frame.height

    def _numbers(self) -> None:
        tool = self._window.views.editor.tool
        kind = _NUMBERS_OF.get(tool, tool)
        if kind in TITLES:
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
            return self._shown_here(editor.commit(edits, title.lower()))

        fields = fields_of(editor.pending or editor.edits, kind, editor.up)
        ask_numbers(self._window.dialogs, title, text, fields, save)

    def _ask_distance(self, start: np.ndarray, end: np.ndarray) -> None:
        editor = self._window.views.editor
        apart = float(np.linalg.norm(end - start))
        now = apart * editor.edits.similarity.scale

        def save(texts: dict[str, str]) -> str:
            try:
                distance = float(texts["distance"])
            except ValueError:
                return f"'{texts['distance']}' is not a number; example: 1.83."
            return self._shown_here(editor.set_scale(start, end, distance))

        text = f"The two points are {now:.4g} apart. How far is that really?"
        ask_numbers(self._window.dialogs, "Scale", text, [("distance", "Distance", f"{now:.4g}")], save)

    def _shown_here(self, refused: str) -> str:
        """Why a change is refused, which the open dialog shows instead of a notice."""
        self._window.notices.clear("edits")
        return refused

    def _ask_range(self, group: range) -> None:
        """In which frames what is selected is to be removed."""
        window, editor = self._window, self._window.views.editor
        assert window.workspace.take is not None
        words, span = window.player.transport.range_words, window.player.transport.span
        number = window.player.transport.number
        own = number(group[0])
        ranges: dict[str, tuple[int, int] | None] = {f"{words(group[0], group[-1])}, this frame's group": (own, own)}
        if span is not None and span[0] <= group[-1] and group[0] <= span[1]:
            ranges[f"{words(*span)}, the span"] = number(span[0]), number(span[1])
        ranges["All frames"] = None
        remove = editor.remove_selected
        window.dialogs.choose("remove", "Remove from", list(ranges), lambda line: remove(ranges[line]), note=REMOVED)
        removals = {words: editor.reaching(frames) for words, frames in ranges.items()}
        self._removal = window.workspace.take, editor.edits, removals
        self._counter.ask(self._removal)

    def _count(self, removal: Removal) -> list[int]:
        def progress(*_: object, **_figures: object) -> None:
            if self._window.dialogs.name != "remove":
                raise Cancelled

        take, before, after = removal
        return newly_removed(take, before, list(after.values()), progress)

    def _counted(self, done: Done[Removal, list[int]]) -> None:
        """Show how many splats would be removed."""
        dialogs, choices = self._window.dialogs, done.request[2]
        if dialogs.name == "remove" and done.request is self._removal:
            counts = [counted(count, "splat") for count in done.result or ()] or ["cannot be counted"] * len(choices)
            dialogs.lines = [f"{words}: {count}" for words, count in zip(choices, counts, strict=True)]
            for number, line in enumerate(dialogs.lines):
                dialogs.widgets[f"choice{number}"].text = line
            self._window.changed()

    def _list(self) -> None:
        window, editor = self._window, self._window.views.editor
        found = describe(editor.edits)
        lines = {f"Take back {singular(name)}: {text}": name for name, text in found.items()}

        def take_back(line: str) -> None:
            kind, _, number = lines[line].partition(" ")
            left = editor.edits.without(kind, int(number) - 1 if number else None)
            editor.commit(left, f"{lines[line]} taken back")

        every = ("clear", "Take back all", partial(editor.commit, EditList(), "all edits taken back"))
        window.dialogs.choose("edits", "Edits", list(lines), take_back, answers=[every] if found else [])
