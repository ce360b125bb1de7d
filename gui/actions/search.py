"""The list of all commands: `Ctrl+K`. Shows why some are not possible now."""

from collections.abc import Callable
from typing import Any

from open3d.visualization import gui

from v3studio.gui.actions.menus import Item, Menus
from v3studio.gui.models.loop import LOOP
from v3studio.gui.shell import Shell
from v3studio.gui.widgets.command_list import Command
from v3studio.gui.widgets.dialogs.command import CommandDialog


def opens_list(event: gui.KeyEvent, shift: bool) -> bool:
    """Whether a key pressed with Ctrl, and maybe Shift, shows the list."""
    return bool(event.key == gui.KeyName.K or (event.key == gui.KeyName.P and shift))


class SearchActions:
    """See the module. `act`: does what an item stands for."""

    def __init__(self, window: Shell, menus: Menus, act: Callable[[Item[Any]], object]) -> None:
        self._window = window
        self._items = {item.key: (title, item) for title, items in menus.items() for item in items if item is not None}
        self.dialog = CommandDialog(window.dialogs, lambda key: act(self._items[key][1]))
        self._possible: dict[int, bool] = {}

    def show(self) -> None:
        """Show the list as soon as Ctrl and Shift are released: dialogs focus their field with Tab, and these change
        what it does. Until then, input is kept for the list."""
        self._window.dialogs.expect()
        LOOP.post(self.show_expected)

    def show_expected(self) -> None:
        """Show the list if it is expected and the keys are released. Call when a modifier is released."""
        dialogs = self._window.dialogs
        if dialogs.expected and not self._window.chords.held:
            try:
                self.dialog.show(
                    [
                        Command(item.key, title, item.words, item.shortcut, self.why_not(item))
                        for title, item in self._items.values()
                        if item.key != "search"
                    ]
                )
            finally:  # input must not stay kept back if that fails
                dialogs.expected = False
            self._window.changed()

    def update(self) -> bool:
        """Keep the list and the gray items of the menus up to date, before a draw; returns whether any changed."""
        bar, before = gui.Application.instance.menubar, self._possible
        self._possible = {
            number: not self.why_not(item) for number, (_, item) in enumerate(self._items.values(), start=1)
        }
        changed = [number for number, on in self._possible.items() if before.get(number, True) != on]
        for number in changed:
            bar.set_enabled(number, self._possible[number])
        return self.dialog.tick() or bool(changed)

    def why_not(self, item: Item[Any]) -> str:
        """Why an item of the menus is not possible now; "" if it is."""
        window = self._window
        opened, history = window.player.opened, window.workspace.history
        if item.needs and opened is None:
            return "No take or stream is open."
        if item.needs == "take" and window.workspace.take is None:
            return "No take is open."
        possible = {
            "undo": (bool(history.made), "Nothing to undo."),
            "redo": (bool(history.undone), "Nothing to redo."),
            "camera": (window.player.camera_names, "There are no cameras yet."),
            "worst": (window.evaluation.frames, "Nothing is evaluated yet. Run Review."),
            "next_mark": (window.marks.notes, "No marks yet. M makes one."),
            "previous_mark": (window.marks.notes, "No marks yet. M makes one."),
            "clear_keys": (window.exports.path.keys, "The camera path is empty."),
            "stop_export": (window.exports.running, "No export is running."),
            "stop_serving": (window.serving.running, "Nothing is served."),
        }
        is_possible, reason = possible.get(item.key, (True, ""))
        if not is_possible:
            return reason
        return "Nothing is trained yet." if item.needs == "splats" and opened and not opened.sources else ""
