"""Presses of keys: each does one thing, whether or not the toolkit reports it, and with which modifiers.

The toolkit's key events have no modifiers. It keeps a press of Escape to itself if a text field takes it, and on a
busy machine has been seen to report one press twice, which would jump over two groups instead of one.
"""

from typing import NamedTuple

from open3d.visualization import gui

from gui.platform.keyboard import BACKSPACE, DOWN, END, HOME, KEYS, PAGE_DOWN, PAGE_UP, TAB, UP
from gui.platform.xlib import ESCAPE

PATIENCE = 10  # ticks within which the toolkit reports a press, if it does
SETTLED = 30
"""Ticks after a press, or the release of Escape, in which a report without a press is another one of the same press."""

_MODIFIERS = {
    gui.KeyName.LEFT_CONTROL: "control",
    gui.KeyName.RIGHT_CONTROL: "control",
    gui.KeyName.META: "control",
    gui.KeyName.LEFT_SHIFT: "shift",
    gui.KeyName.RIGHT_SHIFT: "shift",
}

_CODES = {
    gui.KeyName.ESCAPE: ESCAPE, gui.KeyName.BACKSPACE: BACKSPACE, gui.KeyName.TAB: TAB, gui.KeyName.ENTER: 36,
    gui.KeyName.LEFT_CONTROL: 37, gui.KeyName.LEFT_SHIFT: 50, gui.KeyName.RIGHT_SHIFT: 62,
    gui.KeyName.RIGHT_CONTROL: 105, gui.KeyName.HOME: HOME, gui.KeyName.UP: UP, gui.KeyName.PAGE_UP: PAGE_UP,
    gui.KeyName.LEFT: 113, gui.KeyName.RIGHT: 114, gui.KeyName.END: END, gui.KeyName.DOWN: DOWN,
    gui.KeyName.PAGE_DOWN: PAGE_DOWN, gui.KeyName.DELETE: 119, gui.KeyName.META: 133,
}  # fmt: skip
"""X key codes of keys that are no letters, as in `keyboard`."""


def typed_code(key: gui.KeyName) -> int | None:
    """The X key code of a key of the toolkit that types a character; None for others."""
    number = int(key)
    return KEYS.get(chr(number).lower() if number < 128 else "")


def key_code(key: gui.KeyName) -> int | None:
    """The X key code of a key of the toolkit; None if it is not known."""
    return _CODES.get(key) or typed_code(key)


class Press(NamedTuple):
    """A press of a key that was passed on to the toolkit, and whether Ctrl and Shift were held."""

    code: int  # X key code
    repeated: bool = False  # whether the key was down already
    control: bool = False
    shift: bool = False


class Chords:
    """See the module. Give it every key event."""

    def __init__(self) -> None:
        self._held: set[object] = set()
        self.again = False  # whether the newest event repeats the press of a key that is held

    def note(self, event: gui.KeyEvent, press: Press | None = None) -> bool:
        """Note an event; returns whether it is one of a modifier. `press`: what X knows of it. The toolkit may have
        lost a release when a dialog opened or closed, so the modifiers are taken from here, and a key repeats only if
        both say so."""
        down = event.type == gui.KeyEvent.Type.DOWN
        if press is not None:
            for key, name in _MODIFIERS.items():
                if not getattr(press, name):
                    self._held.discard(key)
            self._held |= {gui.KeyName.LEFT_CONTROL} if press.control and not self.control else set()
            self._held |= {gui.KeyName.LEFT_SHIFT} if press.shift and not self.shift else set()
        self.again = down and event.key in self._held and (press is None or press.repeated)
        (self._held.add if down else self._held.discard)(event.key)
        return event.key in _MODIFIERS

    def release_all(self) -> None:
        """Note that no key is held: the toolkit does not always report a release when a dialog opens or closes."""
        self._held.clear()

    @property
    def held(self) -> bool:
        """Whether Ctrl or Shift is held."""
        return self.control or self.shift

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


class Escapes:
    """See the module. Call `tick` at each tick."""

    def __init__(self) -> None:
        self.dialog = False  # whether a dialog is open; the window sets it
        self._tick = 0
        self._unheard: list[tuple[int, bool]] = []  # presses passed on to the toolkit: tick, whether a dialog was open
        self._last = -SETTLED

    def tick(self) -> None:
        """Note that the window has ticked."""
        self._tick += 1
        while self._unheard and self._tick >= self._unheard[0][0] + SETTLED:
            del self._unheard[0]  # kept by a text field outside of dialogs

    def pressed(self) -> None:
        """Note a press that is passed on to the toolkit; not the repeats of a key that is held."""
        self._unheard.append((self._tick, self.dialog))
        self._last = self._tick

    def released(self) -> None:
        """Note a release that is passed on to the toolkit."""
        self._last = self._tick

    @property
    def recent(self) -> bool:
        """Whether a press or release was passed on so recently that the toolkit may not have handled it yet."""
        return self._tick < self._last + PATIENCE

    def heard(self, again: bool) -> bool:
        """Note that the toolkit reports a press; returns whether it is one that nothing was done about. `again`:
        whether the key was down already, as far as the toolkit has reported. Presses that did not come through here, as
        with the pointer outside of the window, are distinguished by it."""
        if self._unheard:
            del self._unheard[0]
            return True
        return not again and self._tick >= self._last + SETTLED

    def kept(self) -> bool:
        """Whether the toolkit has kept a press in the open dialog to itself; True once for each press. Without a dialog
        nobody would act on it, and a report that comes late still counts."""
        late = self._tick - PATIENCE
        due = [number for number, (tick, within) in enumerate(self._unheard) if within and tick <= late]
        if not self.dialog or not due:
            return False
        del self._unheard[due[0]]
        self._last = self._tick
        return True


class KeyReports:
    """See the module. Call `tick` at each tick."""

    def __init__(self) -> None:
        # presses passed on to the toolkit, and reports that were dropped, for bug reports
        self.passed = self.again = 0
        self._tick = 0
        self._unheard: list[tuple[int, Press]] = []  # presses that were passed on, with their ticks
        self._last = -SETTLED

    def tick(self) -> None:
        """Note that the window has ticked."""
        self._tick += 1
        while self._unheard and self._tick >= self._unheard[0][0] + SETTLED:
            del self._unheard[0]  # a text field kept it

    def press(self, press: Press) -> None:
        """Note a press, or a repeat of a key that is held, that is passed on to the toolkit."""
        self.passed += 1
        self._unheard.append((self._tick, press))
        self._last = self._tick

    def reported(self, code: int | None) -> tuple[bool, Press | None]:
        """Note that the toolkit reports a press, with its X key code; None if that is not known. Returns whether it is
        to be acted on, and the press that was passed on, if any. Presses that did not come through here, as with the
        pointer outside of the window, are acted on long after the last one that did."""
        for number, (_, press) in enumerate(self._unheard):
            if code in (None, press.code):
                del self._unheard[: number + 1]  # a text field kept those before it
                return True, press
        if not self.settled:
            self.again += 1
        return self.settled, None

    @property
    def settled(self) -> bool:
        """Whether the last press was passed on so long ago that the toolkit has reported it."""
        return self._tick >= self._last + SETTLED
