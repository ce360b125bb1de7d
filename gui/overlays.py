"""What lies over the panels: the start page, the notice, the tour. Keeps them up to date and gives them their keys."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.actions.commands import Actions
from gui.actions.search import opens_list
from gui.drawing.palette import ACCENT_DARK, GROUND, PANEL, TEXT
from gui.models.take.title import window_title
from gui.shell import Shell
from gui.widgets.picture import color


class Overlays:
    """See the module.

    Args:
        window: the main window.
        actions: what keys do.
        changed: called when something must be drawn again.
    """

    def __init__(self, window: Shell, actions: Actions, changed: Callable[[], None]) -> None:
        self._window, self._actions, self._changed = window, actions, changed
        self._marked: str | None = None

    @property
    def title(self) -> str:
        """Title of the window."""
        window = self._window
        name = window.player.opened.title if window.player.opened is not None else ""
        queued = self._actions.start.page.running if window.start.shown else None
        return window_title(name, window.workspace, queued)

    @property
    def line(self) -> str:
        """The notice in the status line; "" if there is none. The tour has the place of notices over the view."""
        notices = self._window.notices
        card = notices.card if self._window.tour_bubble.words else None
        return notices.line or (card.line if card is not None and not card.bad else "")

    def update(self) -> bool:
        """Show the state; returns whether anything changed. Call before the window is drawn."""
        window, tour = self._window, self._actions.tour
        words = tour.words if not window.camera_menu.camera else ""
        room = window.layout.view[2]
        changed = window.start.update(window.notices.line) | self._tell_in_fullscreen()
        hidden = bool(words or window.camera_menu.camera)
        layout = window.notice_bar.update(room, hidden)
        card = window.notices.card
        if card is not None and card.bad:
            words = ""  # Open3D draws more than 20 widgets wrongly: a failure takes the place of the tour
        window.tour_bubble.target = tour.target
        layout |= window.tour_bubble.update(words, room)
        changed |= self._mark(tour.tour.step.target if words and tour.tour.step is not None else "")
        if layout:
            window.laid_out()
        return changed or layout

    def _tell_in_fullscreen(self) -> bool:
        """Show the remark over the view while there is no status line; returns whether anything changed."""
        window, status = self._window, self._window.status
        if not window.layout.fullscreen or window.start.shown:
            return False
        line = f"  {self.line}  " if self.line else ""  # a margin
        if status.visible == bool(line) and (not line or status.text == line):
            return False
        status.text, status.visible, status.text_color = line, bool(line), color(TEXT)
        window.laid_out()
        return True

    def _mark(self, target: str) -> bool:
        """Highlight the control that the tour is about."""
        window = self._window
        changed = False
        pictures = {
            "stages": window.stages.list,
            "viewport": window.viewport.picture,
            "timeline": window.timeline.picture,
        }
        for name, picture in pictures.items():
            changed |= picture.outline(name == target)
        if target == self._marked:
            return changed
        self._marked = target
        window.stages.row.background_color = color(ACCENT_DARK if target == "run" else PANEL)
        for panel in window.stages.settings.values():
            panel.widget.background_color = color(ACCENT_DARK if target == "settings" else PANEL)
        for row in window.modes.rows.values():
            row.widget.background_color = color(ACCENT_DARK if target == "modes" else GROUND)
        return True

    def key(self, event: gui.KeyEvent, control: bool, shift: bool, again: bool) -> bool:
        """Handle a key that is pressed while no dialog is open; returns whether it was for one of them.

        Args:
            event: the key.
            control, shift: whether these are held.
            again: whether the key is held, which only moves the focus on.
        """
        window, actions, key = self._window, self._actions, gui.KeyName
        if again and (control or event.key in (key.ENTER, key.BACKSPACE, key.DELETE, key.H)):
            return window.start.shown or bool(window.tour_bubble.words) or event.key == key.H
        if control and event.key == key.C and window.notices.card is not None:
            actions.notices.copy()
            return True
        if control and event.key == key.C and not window.start.shown and actions.notices.copy_table():
            return True
        if control and event.key == key.O and window.notices.card is not None:
            actions.notices.open_folder()
            return True
        if window.start.shown:
            if control:
                if opens_list(event, shift):
                    return False
                if event.key == key.V:
                    actions.start.paste()
                return True
            if event.key in (key.H, key.Q, key.QUESTION_MARK, key.SLASH):
                return False
            window.start.key(event, shift)
            return True
        if window.tour_bubble.words and not control and event.key in (key.ENTER, key.BACKSPACE):
            actions.tour.act("next" if event.key == key.ENTER else "back")
            return True
        return False

    def escape(self) -> bool:
        """Handle Escape; returns whether something was closed."""
        if self._actions.notices.dismiss():
            return True
        if self._window.tour_bubble.words and self._actions.tour.tour.stop():
            self._window.laid_out()
            return True
        return self._window.start.shown and self._actions.start.hide()
