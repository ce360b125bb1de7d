"""Undo and redo of changes of settings, marks and edits."""

from collections.abc import Callable
from dataclasses import dataclass

from v3studio.studio.errors import StudioError

MOST = 200  # changes that are remembered
_LASTING = ("take.mark_changed", "take.edits_changed")  # refusals that will be repeated


@dataclass(frozen=True)
class Change:
    """A change that was made. `undo`, `redo`: raise StudioError where that is refused."""

    words: str
    undo: Callable[[], object]
    redo: Callable[[], object]


class History:
    """Changes that were made, and those that were undone since the last one. A refused one stays where it is, such as
    during a run, unless it can never be made: somebody else has changed the same mark."""

    def __init__(self) -> None:
        self.made: list[Change] = []
        self.undone: list[Change] = []

    def add(self, change: Change) -> None:
        """Note a change that was made."""
        self.made = [*self.made, change][-MOST:]
        self.undone.clear()

    def undo(self) -> str:
        """Reverse the last change; returns what was done or why not, as a sentence."""
        return self._step(self.made, self.undone, "undo")

    def redo(self) -> str:
        """Make the last change that was undone again; returns what was done or why not, as a sentence."""
        return self._step(self.undone, self.made, "redo")

    @staticmethod
    def _step(source: list[Change], target: list[Change], act: str) -> str:
        if not source:
            return f"Nothing to {act}."
        try:
            getattr(source[-1], act)()
        except StudioError as error:
            if error.code in _LASTING:
                source.pop()
            return str(error)
        change = source.pop()
        target.append(change)
        return f"{'Undone' if act == 'undo' else 'Redone'}: {change.words}."
