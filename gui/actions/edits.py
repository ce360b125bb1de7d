"""Edits: the dialogs of their buttons, and what follows a change."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from open3d.visualization import gui

from v3studio.gui.models.loop import later
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.models.worker import Done, LatestWorker
from v3studio.gui.pages.review.numbers import TITLES, fields_of, with_numbers
from v3studio.gui.pages.review.tools import Tool
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.form import ask_numbers
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
"""Keys of `TITLES` that *Numbers* sets while a tool of another name is chosen."""


class EditActions:
    """Edits of the open take: dialogs, the brush, undo and redo."""

    def __init__(
        self, player: PlayerPresenter, workspace: Workspace, views: StageViews, dialogs: Dialogs, notices: Notices,
        changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._player, self._workspace, self._views = player, workspace, views
        self._dialogs, self._notices, self._changed = dialogs, notices, changed
        self._known = EditList()
        self._counter: LatestWorker[Removal, list[int]] = LatestWorker(self._count, "v3studio count", self._counted)
        self._removal: Removal | None = None
        views.edit_dialog.connect(later(lambda key: self._list() if key == "list" else self._numbers()))
        views.editor.two_points.connect(later(self._ask_distance))
        views.editor.range_wanted.connect(later(self._ask_range))
        views.editor.refusal.connect(partial(notices.show, bad=True, topic="edits"))
        workspace.changed.connect(self._follow_edits)

    def show(self) -> None:
        self._views.select("review")
        self._views.edit()

    def undo(self) -> None:
        """Reverse the last change of settings, marks or edits."""
        self._step(self._workspace.history.undo)

    def redo(self) -> None:
        """Make the last change that was undone again."""
        self._step(self._workspace.history.redo)

    def _step(self, step: Callable[[], str]) -> None:
        self._notices.show(step())
        self._views.editor.pending = None  # what was selected belongs to other edits

    def moved(self, pointer: tuple[float, float] | None) -> None:
        """The pointer has moved: the brush follows it. `pointer`: relative to the view's size; None outside it."""
        editor = self._views.editor
        editor.pointer = pointer if editor.tool == Tool.BRUSH else None

    def _follow_edits(self) -> None:
        now = self._views.editor.edits
        if now != self._known:
            self._known = now
            self._notices.clear("edits")
            self._player.refresh()

    def keys(self) -> dict[Any, Callable[[], object]]:
        """Key bindings while the brush is chosen."""
        key, editor = gui.KeyName, self._views.editor
        if not self._views.edits_take or editor.tool != Tool.BRUSH:
            return {}
        smaller, larger = partial(editor.step_brush, -1), partial(editor.step_brush, 1)
        return {key.MINUS: smaller, key.PLUS: larger, key.EQUALS: larger}  # + is Shift and = on many keyboards

    def _numbers(self) -> None:
        tool = self._views.editor.tool
        kind = _NUMBERS_OF.get(tool, tool)
        if kind in TITLES:
            self._ask(kind)
            return
        lines = {title: kind for kind, (title, _) in TITLES.items()}
        self._dialogs.choose("edit kinds", "Which numbers?", list(lines), lambda line: self._ask(lines[line]))

    def _ask(self, kind: str) -> None:
        editor = self._views.editor
        title, text = TITLES[kind]

        def save(texts: dict[str, str]) -> str:
            edits = with_numbers(editor.pending or editor.edits, kind, texts, editor.up)
            if isinstance(edits, str):
                return edits
            if kind == editor.tool == Tool.FLOATERS:
                editor.pending = edits  # shown before it is removed
                return ""
            return self._shown_here(editor.commit(edits, title.lower()))

        fields = fields_of(editor.pending or editor.edits, kind, editor.up)
        ask_numbers(self._dialogs, title, text, fields, save)

    def _ask_distance(self, start: np.ndarray, end: np.ndarray) -> None:
        editor = self._views.editor
        apart = float(np.linalg.norm(end - start))
        now = apart * editor.edits.similarity.scale

        def save(texts: dict[str, str]) -> str:
            try:
                distance = float(texts["distance"])
            except ValueError:
                return f"'{texts['distance']}' is not a number; example: 1.83."
            return self._shown_here(editor.set_scale(start, end, distance))

        text = f"The two points are {now:.4g} apart. How far is that really?"
        ask_numbers(self._dialogs, "Scale", text, [("distance", "Distance", f"{now:.4g}")], save)

    def _shown_here(self, refused: str) -> str:
        """Return why a change is refused, which the open dialog shows instead of a notice."""
        self._notices.clear("edits")
        return refused

    def _ask_range(self, group: range) -> None:
        """Ask in which frames to remove what is selected."""
        editor, take, transport = self._views.editor, self._workspace.take, self._player.transport
        assert take is not None
        words, span, number = transport.range_words, transport.span, transport.number
        own = number(group[0])
        ranges: dict[str, tuple[int, int] | None] = {f"{words(group[0], group[-1])}, this frame's group": (own, own)}
        if span is not None and span[0] <= group[-1] and group[0] <= span[1]:
            ranges[f"{words(*span)}, the span"] = number(span[0]), number(span[1])
        ranges["All frames"] = None
        remove = editor.remove_selected
        self._dialogs.choose("remove", "Remove from", list(ranges), lambda line: remove(ranges[line]), note=REMOVED)
        removals = {words: editor.reaching(frames) for words, frames in ranges.items()}
        self._removal = take, editor.edits, removals
        self._counter.ask(self._removal)

    def _count(self, removal: Removal) -> list[int]:
        def progress(*_: object, **_figures: object) -> None:
            if self._dialogs.name != "remove":
                raise Cancelled

        take, before, after = removal
        return newly_removed(take, before, list(after.values()), progress)

    def _counted(self, done: Done[Removal, list[int]]) -> None:
        """Show how many splats would be removed."""
        dialogs, choices = self._dialogs, done.request[2]
        if dialogs.name == "remove" and done.request is self._removal:
            counts = [counted(count, "splat") for count in done.result or ()] or ["cannot be counted"] * len(choices)
            dialogs.lines = [f"{words}: {count}" for words, count in zip(choices, counts, strict=True)]
            for number, line in enumerate(dialogs.lines):
                dialogs.widgets[f"choice{number}"].text = line
            self._changed()

    def _list(self) -> None:
        editor = self._views.editor
        lines = {f"Take back {singular(name)}: {text}": name for name, text in describe(editor.edits).items()}

        def take_back(line: str) -> None:
            kind, _, number = lines[line].partition(" ")
            left = editor.edits.without(kind, int(number) - 1 if number else None)
            editor.commit(left, f"{lines[line]} taken back")

        every = ("clear", "Take back all", partial(editor.commit, EditList(), "all edits taken back"))
        self._dialogs.choose("edits", "Edits", list(lines), take_back, answers=[every] if lines else [])
