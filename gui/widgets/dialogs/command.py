"""A dialog that finds commands by typing, and runs one of them."""

from collections.abc import Callable, Sequence

from open3d.visualization import gui

from v3studio.gui.platform.keyboard import DOWN, PAGE_DOWN, PAGE_UP, UP
from v3studio.gui.platform.presses import key_code
from v3studio.gui.widgets.command_list import ROWS, Command, CommandList, row_height, search
from v3studio.gui.widgets.dialogs.base import Dialogs
from v3studio.gui.widgets.picture import ImagePanel

NAME = "commands"
WIDTH = 42  # width of the list, em

KEYS = "Up and Down select, Enter runs, Escape closes."

_CODES = {UP: -1, DOWN: 1, PAGE_UP: -ROWS, PAGE_DOWN: ROWS}  # rows by the X key code


class CommandDialog:
    """Finds commands by typing, and runs one. `run`: called with its key, after the dialog has closed."""

    def __init__(self, dialogs: Dialogs, run: Callable[[str], object]) -> None:
        self._dialogs, self._run = dialogs, run
        self._commands: Sequence[Command] = ()
        self._list = CommandList(())
        self._drawn: object = None
        self._picture: ImagePanel | None = None
        self._images: dict[tuple[int, ...], gui.UIImage] = {}  # of all openings
        self._pressed: Command | None = None  # by the mouse
        self._moved: set[int] = set()  # steps of keys whose press has counted

    def show(self, commands: Sequence[Command]) -> None:
        dialogs = self._dialogs
        self._commands, self._list, self._drawn = commands, CommandList(commands), None
        self._pressed, self._moved = None, set()
        edit = gui.TextEdit()
        edit.placeholder_text = "type part of a command"
        edit.set_on_text_changed(self._type)
        self._width = min(round(WIDTH * dialogs.em), dialogs.room)
        picture = self._picture = ImagePanel(self._on_mouse, self._images)
        self.update()  # before it is shown, as the dialog does not resize
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

    def update(self) -> bool:
        """Show what was typed and selected; returns whether anything changed. Call at each tick."""
        if self._picture is None:
            return False
        self._dialogs.lines = [command.words for command in self._list.found]
        if self._list == self._drawn:
            return False
        self._drawn = self._list
        self._picture.show(self._list.image(self._width, self._dialogs.em))
        return True

    def tick(self) -> bool:
        """Call at each tick of the window; returns whether anything changed."""
        if self._dialogs.name != NAME:
            self._picture = None
        return self.update()

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
        self._run(command.key)
