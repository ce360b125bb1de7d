"""Undo and redo of changes of settings, marks and edits."""

from collections.abc import Callable
from dataclasses import dataclass

from studio.errors import Message, StudioError

MOST = 200  # changes that are remembered
_LASTING = ("take.mark_changed", "take.edits_changed")  # refusals that will be repeated


@dataclass(frozen=True)
class Change:
    """A change that was made. `undo`, `redo`: return why that was refused, or None, or raise StudioError."""

    words: str
    undo: Callable[[], Message | None]
    redo: Callable[[], Message | None]


class History:
    """Changes that were made, and those that were undone since the last one. A refused one stays where it is, such as
    during a run, unless it can never be made: somebody else has changed the same mark."""

    def __init__(self) -> None:
        self._made: list[Change] = []
        self._undone: list[Change] = []

    def add(self, change: Change) -> None:
        """Note a change that was made."""
        self._made = [*self._made, change][-MOST:]
        self._undone.clear()

    @property
    def can_undo(self) -> bool:
        return bool(self._made)

    @property
    def can_redo(self) -> bool:
        """Whether a change was undone last."""
        return bool(self._undone)

    def undo(self) -> str:
        """Reverse the last change; returns what was done or why not, as a sentence."""
        return self._step(self._made, self._undone, "Undone", lambda change: change.undo())

    def redo(self) -> str:
        """Make the last change that was undone again; returns what was done or why not, as a sentence."""
        return self._step(self._undone, self._made, "Redone", lambda change: change.redo())

    @staticmethod
    def _step(source: list[Change], target: list[Change], word: str, act: Callable[[Change], Message | None]) -> str:
        if not source:
            return f"Nothing to {'undo' if word == 'Undone' else 'redo'}."
        try:
            refusal = act(source[-1])
        except StudioError as error:
            refusal = error.message
        if refusal is not None:
            if refusal.code in _LASTING:
                source.pop()
            return str(refusal)
        change = source.pop()
        target.append(change)
        return f"{word}: {change.words}."
