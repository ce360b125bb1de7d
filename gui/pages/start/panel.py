"""The start page as a widget that covers the window."""

from collections.abc import Callable

import numpy as np
from open3d.visualization import gui

from v3studio.gui.pages.start.drawing import HINTS, StartImage
from v3studio.gui.pages.start.page import StartPage
from v3studio.gui.widgets.picture import ImagePanel

_MOVES = {gui.KeyName.LEFT: (-1, 0), gui.KeyName.RIGHT: (1, 0), gui.KeyName.UP: (0, -1), gui.KeyName.DOWN: (0, 1)}


class StartPanel:
    """The start page over the window. `act`: called with the name of the chosen button or card, see `StartImage`."""

    def __init__(self, page: StartPage, em: float, act: Callable[[str], None], changed: Callable[[], None]) -> None:
        self.page, self._em, self._act, self._changed = page, em, act, changed
        self.shown = False
        self.picture = ImagePanel(self._on_mouse)
        self.picture.widget.visible = False
        self._list = StartImage(16, 16, em)
        self._hover = self._pressed = ""
        self._down = 0.0

    @property
    def places(self) -> dict[str, list[float]]:
        """The middles of buttons and cards, 0 to 1 across and down the page, by name."""
        size = self.picture.size
        return self._list.boxes.middles(size) | self._list.crosses.middles(size)

    def update(self, line: str) -> bool:
        """Draw what has changed; returns whether anything did. `line`: a passing notice; "" for none."""
        if not self.shown:
            return False
        size = self.picture.size

        def draw() -> np.ndarray:
            self._list = StartImage(*size, self._em, self._down)
            pixels = self._list.draw(self.page, self._hover, line)
            if self._down > self._list.most_down:
                self._down = self._list.down = self._list.most_down
                pixels = self._list.draw(self.page, self._hover, line)
            return pixels

        return self.picture.update((size, self.page.state(), self._hover, self._down, line), draw)

    def key(self, event: gui.KeyEvent, shift: bool) -> None:
        """Handle a key that is pressed."""
        key, page = event.key, self.page
        if key in _MOVES:
            page.move(self._list.boxes.all, *_MOVES[key])
        elif key == gui.KeyName.TAB:
            page.step(self._list.boxes.all, -1 if shift else 1)
        elif key == gui.KeyName.ENTER:
            if any(name == page.focus for _, name in self._list.boxes.all):
                self._act(page.focus)
        elif key in (gui.KeyName.DELETE, gui.KeyName.BACKSPACE) and page.focus.startswith("card "):
            self._act(page.focus.replace("card", "remove"))
        else:
            return
        self._down = self._list.scrolled_to(page.focus)
        self._changed()

    def _on_mouse(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type == kind.WHEEL:
            self._down = min(max(self._down - 3 * self._em * event.wheel_dy, 0.0), self._list.most_down)
            self._changed()
            return True
        name = self._list.at(x, y)
        if event.type == kind.MOVE and name != self._hover:
            self._hover = name
            self.picture.widget.tooltip = HINTS.get(name.split(" ")[0], "")
            self._changed()
        elif event.type == kind.BUTTON_DOWN:
            self._pressed = name
            if name and not name.startswith("remove"):
                self.page.focus = name
            self._changed()
        elif event.type == kind.BUTTON_UP:
            pressed, self._pressed = self._pressed, ""
            if name and name == pressed:
                self._act(name)
            self._changed()
        else:
            return False
        return True
