"""What lies over the panels: the start page and the notice. Keeps them up to date."""

from v3studio.gui.actions.commands import Actions
from v3studio.gui.drawing.canvas import shortened
from v3studio.gui.drawing.palette import TEXT
from v3studio.gui.models.stage_rows import stage_name
from v3studio.gui.models.take.run_state import percent
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.picture import color, put

PROGRAM = "V3 Studio"

MESSAGE_LINES, MESSAGE_WIDTH = 10, 0.8
"""Most lines of the message over the view, and their width as a share of the view's."""

MORE = "... (the log has the rest, J)"


class Overlays:
    """See the module. `actions`: have the start page."""

    def __init__(self, window: Shell, actions: Actions) -> None:
        self._window, self._actions = window, actions
        self._message_of: object = None
        self._message = self._noted = ""

    @property
    def title(self) -> str:
        """ "37% Train - NAME - V3 Studio" in a run, on the start page also of the queue; else "NAME - V3 Studio"."""
        window, run = self._window, self._window.workspace.run
        name, words = window.player.opened.title if window.player.opened is not None else "", ""
        queued = self._actions.start.page.running if window.start.shown else None
        if window.workspace.busy and run.stage:
            words = run_words(run.stage, run.progress.fraction if run.progress is not None else None)
            words += ", paused" if window.workspace.paused else ""
        elif queued is not None:
            name, words = queued[0], run_words(*queued[1:])
        return " - ".join(filter(None, (words, name, PROGRAM)))

    def update(self) -> bool:
        """Show the state; returns whether anything changed. Call before the window is drawn."""
        window = self._window
        changed = window.start.update(window.notices.line) | self._show_in_fullscreen() | self._show_message()
        layout = window.notice_bar.update(window.layout.view[2], bool(window.camera_menu.camera))
        if layout:
            window.window.set_needs_layout()
        return changed or layout

    def _show_message(self) -> bool:
        """Show the message, or its beginning, over the view: the log has all of it. Returns whether it changed."""
        window = self._window
        message, room = window.workspace.problem or window.views.message, MESSAGE_WIDTH * window.layout.view[2]
        if self._message_of != (message, room):
            self._message_of = (message, room)
            lines = shortened(message, round(window.em), room, MESSAGE_LINES, MORE)
            self._message = "\n".join(lines) if MORE in lines else message
            if MORE in lines and self._noted != message:
                self._noted = message
                window.workspace.note(message, failed=True)
        # even an empty label blocks the mouse
        changed = put(window.message, text=self._message, visible=bool(message) and not window.start.shown)
        if changed:
            window.window.set_needs_layout()  # otherwise a label keeps the width of its first text
        return changed

    def _show_in_fullscreen(self) -> bool:
        """Show the remark over the view while there is no status line; returns whether anything changed."""
        window, status = self._window, self._window.status
        if not window.layout.fullscreen or window.start.shown:
            return False
        line = f"  {window.notices.line}  " if window.notices.line else ""  # a margin
        changed = put(status, text=line, visible=bool(line))
        if changed:
            status.text_color = color(TEXT)
            window.window.set_needs_layout()
        return changed


def run_words(stage: str, fraction: float | None) -> str:
    """ "37% Train"; only the stage if it has not reported its progress."""
    name = stage_name(stage)
    return name if fraction is None else f"{percent(fraction)} {name}"
