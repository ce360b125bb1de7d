"""A button with a symbol: a picture that is drawn at its size on the screen, so that it is sharp at every scale."""

from __future__ import annotations

from collections.abc import Callable

from open3d.visualization import gui

from gui.drawing.palette import ACCENT_DARK, BORDER, FAINT, PANEL, RAISED, TEXT
from gui.drawing.symbols import framed, symbol
from gui.widgets.picture import PictureWidget


class SymbolButton(PictureWidget):
    """See the module. Call `update` at each draw.

    Args:
        name: key of `SYMBOLS`.
        action: called when it is pressed and released.

    Attributes:
        name: the symbol; may be changed.
    """

    def __init__(self, name: str, action: Callable[[], object]) -> None:
        super().__init__(self._clicked)
        self.name = name
        self._action = action
        self._pressed = False
        self._drawn: object = None

    def update(self) -> bool:
        """Draw what has changed; returns whether anything did."""
        state = (self.name, self.size, self._pressed, self.widget.enabled)
        if state == self._drawn:
            return False
        self._drawn = state
        ground = ACCENT_DARK if self._pressed else RAISED
        enabled = self.widget.enabled
        drawn = symbol(self.name, self.size, TEXT if enabled else FAINT, ground)
        self.show(framed(drawn, BORDER if enabled else FAINT, PANEL))
        return True

    def _clicked(self, event: gui.MouseEvent, x: float, y: float) -> bool:
        kind = gui.MouseEvent.Type
        if event.type not in (kind.BUTTON_DOWN, kind.BUTTON_UP) or not self.widget.enabled:
            return False
        pressed, self._pressed = self._pressed, event.type == kind.BUTTON_DOWN
        width, height = self.size
        if pressed and event.type == kind.BUTTON_UP and 0 <= x < width and 0 <= y < height:
            self._action()
        return True
