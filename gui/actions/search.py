"""The list of all commands, found by typing: `Ctrl+K`. Shows why some are not possible now."""

from collections.abc import Callable, Sequence
from typing import Any

from open3d.visualization import gui

from v3studio.gui.actions.menus import Item, Menus
from v3studio.gui.models.loop import LOOP
from v3studio.gui.platform.keyboard import DOWN, PAGE_DOWN, PAGE_UP, UP
from v3studio.gui.platform.presses import Chords, key_code
from v3studio.gui.widgets.command_list import ROWS, Command, CommandList, row_height, search
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.picture import ImagePanel

NAME = "commands"
WIDTH = 42  # width of the list, em

KEYS = "Up and Down select, Enter runs, Escape closes."

_CODES = {UP: -1, DOWN: 1, PAGE_UP: -ROWS, PAGE_DOWN: ROWS}  # rows by the X key code


def opens_list(event: gui.KeyEvent, shift: bool) -> bool:
    """Whether a key pressed with Ctrl, and maybe Shift, shows the list."""
    return bool(event.key == gui.KeyName.K or (event.key == gui.KeyName.P and shift))


class SearchActions:
    """Shows the list, which is searched by typing, and which items of the menus are possible. `act`: does what an item
    stands for. `why_not`: gives the reason why an item is not possible now; "" if it is."""

    def __init__(
        self, dialogs: Dialogs, chords: Chords, menus: Menus, act: Callable[[Item[Any]], object],
        why_not: Callable[[Item[Any]], str], changed: Callable[[], None],
    ) -> None:  # fmt: skip
        self._dialogs, self._chords, self._act = dialogs, chords, act
        self._why_not, self._changed = why_not, changed
        self._items = {item.key: (title, item) for title, items in menus.items() for item in items if item is not None}
        self._possible: dict[int, bool] = {}
        self._commands: Sequence[Command] = ()
        self._list = CommandList(())
        self._drawn: object = None
        self._picture: ImagePanel | None = None
        self._images: dict[tuple[int, ...], gui.UIImage] = {}  # of all openings
        self._pressed: Command | None = None  # by the mouse
        self._moved: set[int] = set()  # steps of keys whose press has counted

    def show(self) -> None:
        """Show the list as soon as Ctrl and Shift are released: dialogs focus their field with Tab, and these change
        what it does. Until then, input is kept for the list."""
        self._dialogs.expect()
        LOOP.post(self.show_expected)

    def show_expected(self) -> None:
        """Show the list if it is expected and the keys are released. Call when a modifier is released."""
        if self._dialogs.expected and not self._chords.held:
            try:
                self._open()
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
        if self._dialogs.name != NAME:
            self._picture = None
        return self._update_list() or bool(changed)

    def _open(self) -> None:
        dialogs = self._dialogs
        self._commands = [
            Command(item.key, title, item.words, item.shortcut, self._why_not(item))
            for title, item in self._items.values()
            if item.key != "search"
        ]
        self._list, self._drawn = CommandList(self._commands), None
        self._pressed, self._moved = None, set()
        edit = gui.TextEdit()
        edit.placeholder_text = "type part of a command"
        edit.set_on_text_changed(self._type)
        self._width = min(round(WIDTH * dialogs.em), dialogs.room)
        picture = self._picture = ImagePanel(self._on_mouse, self._images)
        self._update_list()  # before it is shown, as the dialog does not resize
        answers = [("run", "Run", self._enter), ("close", "Cancel", dialogs.close)]
        dialogs.show(NAME, "Commands", [edit, picture.widget, dialogs.label(KEYS)], answers, 40, self._enter)
        dialogs.widgets["line"] = edit
        dialogs.widgets["list"], dialogs.parts["list"] = picture.widget, lambda: self._list.places
        dialogs.pictures, dialogs.on_key, dialogs.on_press = [picture], self._key, self._press
        dialogs.focus(edit)
        dialogs.lay_out()

    def _type(self, text: str) -> None:
        # shown at the next tick: the toolkit tells of typing while it draws
        self._list = CommandList(search(self._commands, text))

    def _update_list(self) -> bool:
        """Show what was typed and selected; returns whether anything changed."""
        if self._picture is None:
            return False
        self._dialogs.lines = [command.words for command in self._list.found]
        if self._list == self._drawn:
            return False
        self._drawn = self._list
        self._picture.show(self._list.image(self._width, self._dialogs.em))
        return True

    def _key(self, event: gui.KeyEvent) -> bool:
        """The field keeps the presses of keys for itself, so a release counts whose press was not reported."""
        step = _CODES.get(key_code(event.key) or 0)
        if step is None:
            return False
        if event.type == gui.KeyEvent.Type.UP:
            if step not in self._moved:
                self._list = self._list.moved(step)
            self._moved.discard(step)
        return True

    def _press(self, code: int) -> None:
        """A key was pressed, or repeats because it is held."""
        step = _CODES.get(code)
        if step is not None:
            self._moved.add(step)
            self._list = self._list.moved(step)

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type == kind.WHEEL:
            self._list = self._list.moved(-round(event.wheel_dy))
        elif event.type in (kind.BUTTON_DOWN, kind.BUTTON_UP):
            row = self._list.row_at(y, ROWS * row_height(self._dialogs.em))
            under = None if row is None else self._list.found[row]
            if event.type == kind.BUTTON_DOWN:
                self._pressed = under
                if row is not None:
                    self._list = self._list.moved(row - self._list.at)
                return True
            pressed, self._pressed = self._pressed, None
            if pressed is not None and under is pressed and row is not None:
                self._list = self._list.moved(row - self._list.at)
                self._enter()
        else:
            return False
        return True

    def _enter(self) -> None:
        """Run the selected command. One that is not possible now stays, with its reason."""
        command = self._list.selected
        if command is None or command.reason:
            return
        self._dialogs.close()
        self._act(self._items[command.key][1])
