"""Keys pressed with Ctrl. The toolkit's key events have no modifiers, so their presses and releases are noted."""

from __future__ import annotations

from open3d.visualization import gui

_MODIFIERS = {
    gui.KeyName.LEFT_CONTROL: "control",
    gui.KeyName.RIGHT_CONTROL: "control",
    gui.KeyName.META: "control",
    gui.KeyName.LEFT_SHIFT: "shift",
    gui.KeyName.RIGHT_SHIFT: "shift",
}


class Chords:
    """See the module. Give it every key event.

    Attributes:
        control, shift: whether such a key is held.
        again: whether the newest event repeats the press of a key that is held.
    """

    def __init__(self) -> None:
        self._held: set[object] = set()
        self.again = False

    def note(self, event: gui.KeyEvent) -> bool:
        """Note an event; returns whether it is one of a modifier."""
        down = event.type == gui.KeyEvent.Type.DOWN
        self.again = down and event.key in self._held
        (self._held.add if down else self._held.discard)(event.key)
        return event.key in _MODIFIERS

    @property
    def control(self) -> bool:
        """Whether Ctrl (on a Mac, Command) is held."""
        return self._any("control")

    @property
    def shift(self) -> bool:
        """Whether Shift is held."""
        return self._any("shift")

    def _any(self, name: str) -> bool:
        return any(_MODIFIERS.get(key) == name for key in self._held)  # type: ignore[call-overload]
