"""The menu that is open, by what the mouse did: the toolkit does not tell.

Its menus follow the pointer once one is open, and a click on the title of an open one closes it. So a click on the next
title, which the pointer has just opened, would close that menu again: such clicks are not passed on. A click in
a menu closes it if it chooses an item, which the toolkit tells, and else leaves it open.
"""

from collections.abc import Callable, Sequence

TITLE_ENDS = (2.56, 5.12, 7.94, 11.06, 14.37, 17.56, 20.63)
"""Right ends of the titles of `gui.actions.commands.MENUS` in font sizes, measured: the toolkit draws them unasked."""


class MenuBar:
    """The open menu. Tell it of all moves and presses, in order. `boxes`: (width, height) of the menus, pixels.
    `height`: returns the height of the bar, pixels; 0 while it is hidden."""

    def __init__(self, em: float, boxes: Sequence[tuple[float, float]], height: Callable[[], float]) -> None:
        self._boxes, self._height = boxes, height
        self._ends = [end * em for end in TITLE_ENDS]
        self._open: int | None = None
        self._followed = False

    @property
    def opened(self) -> bool:
        """Whether a menu is open, as far as the toolkit shows."""
        return self._open is not None

    def closed(self) -> None:
        """Note that no menu is open."""
        self._open = None

    def move(self, x: float, y: float) -> None:
        """The pointer is at a position in the window, pixels."""
        title = self._title(x, y)
        if self._open is not None and title is not None and title != self._open:
            self._open, self._followed = title, True

    def press(self, x: float, y: float) -> bool:
        """The left button is pressed; returns whether the toolkit is to see that."""
        self.move(x, y)
        title = self._title(x, y)
        if title is not None and title == self._open and self._followed:
            self._followed = False
            return False
        self._followed = False
        if not self._in_menu(x, y):
            self._open = None if title == self._open else title
        return True

    def _in_menu(self, x: float, y: float) -> bool:
        """Whether a position is in the open menu."""
        if self._open is None:
            return False
        left, (width, height) = self._ends[self._open - 1] if self._open else 0.0, self._boxes[self._open]
        return left <= x < left + width and 0 <= y - self._height() < height

    def _title(self, x: float, y: float) -> int | None:
        if not 0 <= y < self._height():
            return None
        return next((number for number, end in enumerate(self._ends) if x < end), None)
