"""Presses of keys: each does one thing, whether or not the toolkit reports it, and with which modifiers.

The toolkit's key events have no modifiers. It keeps a press of Escape to itself if a text field takes it, and on a
busy machine has been seen to report one press twice, which would jump over two groups instead of one.
"""

from collections.abc import Callable
from typing import NamedTuple

from open3d.visualization import gui

from v3studio.gui.platform.keyboard import BACKSPACE, DOWN, END, HOME, KEYS, PAGE_DOWN, PAGE_UP, TAB, UP
from v3studio.gui.platform.xlib import ESCAPE

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
    """The modifiers that are held. Give it every key event."""

    def __init__(self) -> None:
        self._held: set[object] = set()
        self.again = False  # whether the newest event repeats the press of a key that is held

    def note(self, event: gui.KeyEvent, press: Press | None = None) -> bool:
        """Note an event; returns whether it is one of a modifier. `press`: what X knows of it. The toolkit may have
        lost a release when a dialog opened or closed, so the modifiers are taken from here, and a key repeats only if
        both say so."""
        down = event.type == gui.KeyEvent.Type.DOWN
        if press is not None:
            self._held -= {key for key, name in _MODIFIERS.items() if not getattr(press, name)}
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


class KeyReports:
    """Matches what the toolkit reports with the presses that it was passed. Call `tick` at each tick."""

    def __init__(self) -> None:
        self.dialog = False  # whether a dialog is open; the window sets it
        self.kept: Callable[[Press], object] = lambda _press: None  # called with a press that a text field has kept
        self._tick = 0
        # presses passed on to the toolkit and not reported yet: tick, press, whether it is one of Escape in a dialog
        self._unheard: list[tuple[int, Press, bool]] = []
        self._last = self._last_escape = -SETTLED

    def tick(self) -> None:
        """Note that the window has ticked."""
        self._tick += 1
        while self._unheard and self._tick >= self._unheard[0][0] + SETTLED:
            self.kept(self._unheard.pop(0)[1])

    def press(self, press: Press) -> None:
        """Note a press, or a repeat of a key that is held, that is passed on to the toolkit."""
        self._last = self._tick
        is_escape = press.code == ESCAPE
        if is_escape and press.repeated:
            return  # does nothing, also if the toolkit has kept the press before it
        self._unheard.append((self._tick, press, is_escape and self.dialog))
        if is_escape:
            self._last_escape = self._tick

    def escape_released(self) -> None:
        """Note a release of Escape that is passed on to the toolkit."""
        self._last_escape = self._tick

    @property
    def escaping(self) -> bool:
        """Whether Escape was passed on so recently that the toolkit may not have handled its press or release yet."""
        return self._tick < self._last_escape + PATIENCE

    def reported(self, code: int | None) -> tuple[bool, Press | None]:
        """Note that the toolkit reports a press, with its X key code; None if that is not known. Returns whether it is
        to be acted on, and the press that was passed on, if any. Presses that did not come through here, as with the
        pointer outside of the window, are acted on long after the last one that did."""
        for number, (_, press, _) in enumerate(self._unheard):
            if code in (None, press.code):
                # a text field kept those before it; Escape in a dialog still has to close it
                before = self._unheard[: number + 1]
                self._unheard[: number + 1] = [unheard for unheard in before if unheard[2] and code != ESCAPE]
                for _, kept, _ in before[:-1]:
                    self.kept(kept)
                return True, press
        return self._tick >= (self._last_escape if code == ESCAPE else self._last) + SETTLED, None

    def escape_kept(self) -> bool:
        """Whether the toolkit has kept a press of Escape in the open dialog to itself; True once for each press.
        Without a dialog nobody would act on it, and a report that comes late still counts."""
        late = self._tick - PATIENCE
        kept = next((unheard for unheard in self._unheard if unheard[2] and unheard[0] <= late), None)
        if not self.dialog or kept is None:
            return False
        self._unheard.remove(kept)
        self._last_escape = self._tick
        return True

    @property
    def settled(self) -> bool:
        """Whether the last press was passed on so long ago that the toolkit has reported it."""
        return self._tick >= self._last + SETTLED
