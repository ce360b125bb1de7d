"""What the menu Mark and its keys do."""

from __future__ import annotations

from collections.abc import Callable

from gui.shell import Shell
from studio.errors import StudioError


class MarkActions:
    """See the module.

    Args:
        window: the main window.
    """

    def __init__(self, window: Shell) -> None:
        self._window = window

    def ask(self) -> None:
        """Ask for a note on the frame on screen, and mark it."""
        window = self._window
        if window.player.opened is None:
            return
        window.player.transport.pause()
        frame = window.player.transport.frame
        known = window.marks.marks.get(frame)
        where = "" if window.marks.kept else " Marks on a stream are lost when it is closed."
        answers: list[tuple[str, str, Callable[[str], None]]] = [
            ("save", "Mark", lambda note: self._try(lambda: window.marks.set(frame, note, known)))
        ]
        if known is not None:
            answers.append(("remove", "Remove mark", lambda _: self._try(lambda: window.marks.remove(frame, known))))
        answers.append(("close", "Cancel", lambda _: None))
        note = "" if known is None else known.note
        window.dialogs.line("mark", f"Mark frame {frame}", f"Note (optional).{where}", note, answers)

    def _try(self, action: Callable[[], object]) -> None:
        try:
            action()
        except StudioError as error:
            self._window.player.message = str(error)
        self._window.marks_changed()

    def go(self, direction: int) -> None:
        """Go to the next (1) or previous (-1) mark."""
        window = self._window
        frame = window.marks.next_after(window.player.transport.frame, direction)
        if frame is not None:
            window.player.transport.pause()
            window.player.transport.seek(frame)

    def show_all(self) -> None:
        """Show the list of marks; choosing one goes to its frame."""
        window = self._window
        lines = {f"{frame}: {note or '(no note)'}": frame for frame, note in sorted(window.marks.notes.items())}
        window.dialogs.choose("marks", "Marks", list(lines), lambda line: window.player.transport.seek(lines[line]))
