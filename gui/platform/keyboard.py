"""Keyboard focus for a dialog's text field. The toolkit has no call for it, but Tab focuses the first field.

So the window sends itself a Tab through X, and again the keys that were pressed before the field had the focus. Without
X nothing happens, and the user has to click or press Tab.
"""

import time
from collections.abc import Sequence
from contextlib import closing

from v3studio.gui.platform.x_window import XDisplay
from v3studio.gui.platform.xlib import EXPOSE, EXPOSURE_MASK, InputEvent

_KEY_PRESS, _KEY_RELEASE = 2, 3
_SHIFT = 1
TAB, BACKSPACE, HOME, END = 23, 22, 110, 115
UP, PAGE_UP, DOWN, PAGE_DOWN = 111, 112, 116, 117
"""X key codes, which name places on the keyboard: the same on all Linux systems, whatever the layout."""

_ROWS = (
    ("`", 49), ("1234567890-=", 10), ("qwertyuiop[]", 24), ("asdfghjkl;'", 38), ("\\", 51), ("zxcvbnm,./", 52),
    (" ", 65),
)  # fmt: skip
KEYS = {letter: first + number for row, first in _ROWS for number, letter in enumerate(row)}
"""X key code by the letter of a place on an American keyboard, which is how the toolkit names keys."""


def send_key(keycode: int, down: bool) -> None:
    """Press or release a key, no letter, in this process's window; the two must fall on different drawn frames."""
    _send([(keycode, down, False)])


def tap_key(keycode: int) -> None:
    """Press a key that is not a letter in this process's window for one drawn frame only: the toolkit would repeat it
    if frames are slow."""
    _send([(keycode, True, False), None, (keycode, False, False)])


def type_keys(keys: Sequence[tuple[int, bool]]) -> None:
    """Press and release keys of letters in this process's window: X key code, and whether Shift is held."""
    _send([(code, down, shift) for code, shift in keys for down in (True, False)])


def type_text(text: str) -> bool:
    """Type a text in this process's window; returns whether the keyboard has keys for all of it."""
    with closing(XDisplay()) as server:
        keys = server.keys_of(text)
    if keys:
        type_keys(keys)
    return keys is not None


def _send(keys: Sequence[tuple[int, bool, bool] | None]) -> None:
    """Send key events: (X key code, whether it is pressed, whether Shift is held), or None to draw the window."""
    with closing(XDisplay()) as server:
        window = server.window
        if window is None:
            return
        # the toolkit drops presses whose time is not after that of the same key's last one; X servers count like this
        now = int(1000 * time.monotonic()) & 0xFFFFFFFF
        events = []
        for number, key in enumerate(keys):
            if key is None:
                events.append((InputEvent(type=EXPOSE), EXPOSURE_MASK))
                continue
            code, down, shift = key
            kind, mask = (_KEY_PRESS, 1) if down else (_KEY_RELEASE, 2)
            event = InputEvent(type=kind, code=code, same_screen=1, time=now + number, state=_SHIFT if shift else 0)
            events.append((event, mask))
        server.send(window, events)
