"""The list of all commands: `Ctrl+K`. Shows why some are not possible now."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from open3d.visualization import gui

from gui.actions.menus import MENUS, MenuStates
from gui.models.loop import LOOP
from gui.shell import Shell
from gui.widgets.command_list import Command
from gui.widgets.dialogs.command import CommandDialog

NEEDS_OPEN = frozenset(
    (
        "screenshot", "reset", "background", "scene", "camera", "figures", "log", "log_warnings", "span", "bakes",
        "mark", "next_mark", "previous_mark", "marks", "path", "add_key", "clear_keys", "stage_help",
        "export", "share folder", "share single-file", "serve",
    )
)  # fmt: skip
"""Commands that need an open take or stream."""

NEEDS_TAKE = frozenset(("report", "edit", "cameras"))
"""Commands that need an open take."""


def opens_list(event: gui.KeyEvent, shift: bool) -> bool:
    """Whether a key pressed with Ctrl, and maybe Shift, shows the list."""
    return bool(event.key == gui.KeyName.K or (event.key == gui.KeyName.P and shift))


class SearchActions:
    """See the module.

    Args:
        window: the main window.
        actions: of the menus, by key.
    """

    def __init__(self, window: Shell, actions: Callable[[], Mapping[str, Callable[[], object]]]) -> None:
        self._window = window
        self._dialog = CommandDialog(window.dialogs, lambda key: actions()[key]())
        self._states = MenuStates(self.why_not)

    def show(self) -> None:
        """Show the list as soon as Ctrl and Shift are released: dialogs focus their field with Tab, and these change
        what it does. Until then, input is kept for the list."""
        self._window.dialogs.expect()
        LOOP.post(self.show_expected)

    def show_expected(self) -> None:
        """Show the list if it is expected and the keys are released. Call when a modifier is released."""
        dialogs = self._window.dialogs
        if dialogs.expected and not self._window.control_held:
            try:
                self._show()
            finally:  # input must not stay kept back if that fails
                dialogs.expected = False
            self._window.changed()

    def _show(self) -> None:
        commands = [
            Command.of(key, title, label, self.why_not(key)) for title, items in MENUS for key, label in items if key
        ]
        self._dialog.show([command for command in commands if command.key != "search"])

    def update(self) -> bool:
        """Keep the menus and the list up to date. Call before the window is drawn; returns whether something
        changed."""
        return self._dialog.tick() | self._states.update(gui.Application.instance.menubar)

    def press(self, button: int, x: int, y: int) -> bool:
        """A mouse button is pressed in the window while a dialog is open; returns whether that closed the list."""
        return self._dialog.press(button, x, y)

    def why_not(self, key: str) -> str:
        """Why a command is not possible now; "" if it is."""
        window = self._window
        opened = window.player.opened
        if key in NEEDS_OPEN and opened is None:
            return "no take or stream is open"
        if key in NEEDS_TAKE and window.workspace.take is None:
            return "no take is open"
        history, path = window.workspace.history, window.exports.path
        exports = key in ("export", "scene", "add_key")
        reasons = {
            "undo": "" if history.can_undo else "nothing to undo",
            "redo": "" if history.can_redo else "nothing to redo",
            "camera": "" if window.player.camera_names else "it has no cameras",
            **dict.fromkeys(("next_mark", "previous_mark"), "" if window.marks.notes else "no marks: M makes one"),
            "clear_keys": "" if path.keys else "the camera path is empty",
            "stop_export": "" if window.exports.running else "no export is running",
            "stop_serving": "" if window.serving.running else "it is not served",
        }
        found = reasons.get(key, "")
        if not found and exports and opened is not None and not opened.sources:
            return "nothing is trained yet"
        return found
