"""The overlays on the panels, kept up to date: the start page, the message over the view and the notice."""

from v3studio.gui.drawing.canvas import shortened
from v3studio.gui.drawing.palette import TEXT
from v3studio.gui.layout import Layout, Panels
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.stage_rows import stage_name
from v3studio.gui.models.take.run_state import percent
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.stage_views import StageViews
from v3studio.gui.widgets.picture import color, put

PROGRAM = "V3 Studio"

MESSAGE_LINES, MESSAGE_WIDTH = 10, 0.8
"""Most lines of the message over the view, and their width as a share of the view's."""

MORE = "... (the log has the rest, J)"


class Overlays:
    """Shows what lies over the panels, and the title. `em`: the font size, pixels."""

    def __init__(
        self, panels: Panels, layout: Layout, workspace: Workspace, views: StageViews, notices: Notices, em: float
    ) -> None:
        self._panels, self._layout, self._em = panels, layout, em
        self._workspace, self._views, self._notices = workspace, views, notices
        self._message_of: object = None
        self._message = self._noted = ""

    @property
    def title(self) -> str:
        """ "37% Train - NAME - V3 Studio" in a run, on the start page also of the queue; else "NAME - V3 Studio"."""
        workspace, start, opened = self._workspace, self._panels.start, self._views.player.opened
        run, name, words = workspace.run, opened.title if opened is not None else "", ""
        queued = start.page.running if start.shown else None
        if workspace.busy and run.stage:
            words = run_words(run.stage, run.progress.fraction if run.progress is not None else None)
            words += ", paused" if workspace.paused else ""
        elif queued is not None:
            name, words = queued[0], run_words(*queued[1:])
        return " - ".join(filter(None, (words, name, PROGRAM)))

    def update(self) -> tuple[bool, bool]:
        """Show the state; return whether anything changed, and whether a layout is due."""
        panels = self._panels
        changed = panels.start.update(self._notices.line)
        # without a layout, a label keeps the width of its first text
        layout = self._show_in_fullscreen() | self._show_message()
        layout |= panels.notice_bar.update(self._layout.view[2], bool(panels.camera_menu.camera))
        return changed | layout, layout

    def _show_message(self) -> bool:
        """Show the message, or its beginning, over the view: the log has all of it. Returns whether it changed."""
        message, room = self._workspace.problem or self._views.message, MESSAGE_WIDTH * self._layout.view[2]
        if self._message_of != (message, room):
            self._message_of = (message, room)
            lines = shortened(message, round(self._em), room, MESSAGE_LINES, MORE)
            self._message = "\n".join(lines) if MORE in lines else message
            if MORE in lines and self._noted != message:
                self._noted = message
                self._workspace.note(message, failed=True)
        # even an empty label blocks the mouse
        visible = bool(message) and not self._panels.start.shown
        return put(self._panels.message, text=self._message, visible=visible)

    def _show_in_fullscreen(self) -> bool:
        """Show the remark over the view while there is no status line; returns whether anything changed."""
        status = self._panels.status
        if not self._layout.fullscreen or self._panels.start.shown:
            return False
        line = f"  {self._notices.line}  " if self._notices.line else ""  # a margin
        changed = put(status, text=line, visible=bool(line))
        if changed:
            status.text_color = color(TEXT)
        return changed


def run_words(stage: str, fraction: float | None) -> str:
    """ "37% Train"; only the stage if it has not reported its progress."""
    name = stage_name(stage)
    return name if fraction is None else f"{percent(fraction)} {name}"
