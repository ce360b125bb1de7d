"""The list of all commands: `Ctrl+K`. Shows why some are not possible now."""

from collections.abc import Callable
from typing import Any

from open3d.visualization import gui

from v3studio.gui.actions.menus import Item, Menus
from v3studio.gui.models.loop import LOOP
from v3studio.gui.platform.presses import Chords
from v3studio.gui.widgets.command_list import Command
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.dialogs.command import CommandDialog


def opens_list(event: gui.KeyEvent, shift: bool) -> bool:
    """Whether a key pressed with Ctrl, and maybe Shift, shows the list."""
    return bool(event.key == gui.KeyName.K or (event.key == gui.KeyName.P and shift))


class SearchActions:
    """Shows the list, and which items of the menus are possible. `act`: does what an item stands for. `why_not`: gives
    the reason why an item is not possible now; "" if it is."""

    def __init__(
        self, dialogs: Dialogs, chords: Chords, menus: Menus, act: Callable[[Item[Any]], object],
        why_not: Callable[[Item[Any]], str], changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._dialogs, self._chords, self._why_not, self._changed = dialogs, chords, why_not, changed
        self._items = {item.key: (title, item) for title, items in menus.items() for item in items if item is not None}
        self.dialog = CommandDialog(dialogs, lambda key: act(self._items[key][1]))
        self._possible: dict[int, bool] = {}

    def show(self) -> None:
        """Show the list as soon as Ctrl and Shift are released: dialogs focus their field with Tab, and these change
        what it does. Until then, input is kept for the list."""
        self._dialogs.expect()
        LOOP.post(self.show_expected)

    def show_expected(self) -> None:
        """Show the list if it is expected and the keys are released. Call when a modifier is released."""
        if self._dialogs.expected and not self._chords.held:
            try:
                self.dialog.show(
                    [
                        Command(item.key, title, item.words, item.shortcut, self._why_not(item))
                        for title, item in self._items.values()
                        if item.key != "search"
                    ]
                )
            finally:  # input must not stay kept back if that fails
                self._dialogs.expected = False
            self._changed()

    def update(self) -> bool:
        """Keep the list and the gray items of the menus up to date, before a draw; returns whether any changed."""
        bar, before = gui.Application.instance.menubar, self._possible
        self._possible = {
            number: not self._why_not(item) for number, (_, item) in enumerate(self._items.values(), start=1)
        }
        changed = [number for number, on in self._possible.items() if before.get(number, True) != on]
        for number in changed:
            bar.set_enabled(number, self._possible[number])
        return self.dialog.tick() or bool(changed)
