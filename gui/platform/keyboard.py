"""Keyboard focus for a dialog's text field. The toolkit has no call for it, but Tab focuses the first field.

So the window sends itself a Tab through X, and again the keys that were pressed before the field had the focus. Without
X nothing happens, and the user has to click or press Tab.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import time
from collections.abc import Sequence
from typing import Any

from gui.platform.x_window import EXPOSE, EXPOSURE_MASK, InputEvent

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
_IGNORE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(lambda _display, _error: 0)


def send_key(keycode: int, down: bool) -> bool:
    """Press or release a key that is not a letter in this process's window; return whether the window was found. Press
    and release must fall on different drawn frames."""
    return _send([(keycode, down, False)])


def tap_key(keycode: int) -> bool:
    """Press a key that is not a letter in this process's window for one drawn frame only: the toolkit would repeat it
    if frames are slow. Returns whether the window was found."""
    return _send([(keycode, True, False), None, (keycode, False, False)])


def type_keys(keys: Sequence[tuple[int, bool]]) -> bool:
    """Press and release keys of letters in this process's window; return whether the window was found.

    Args:
        keys: X key code, and whether Shift is held.
    """
    return _send([(code, down, shift) for code, shift in keys for down in (True, False)])


def _send(keys: Sequence[tuple[int, bool, bool] | None]) -> bool:
    """Send key events: (X key code, whether it is pressed, whether Shift is held), or None to draw the window."""
    name = ctypes.util.find_library("X11")
    if name is None:
        return False
    x11 = ctypes.CDLL(name)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = x11.XOpenDisplay(None)
    if not display:
        return False
    handle = ctypes.c_void_p(display)
    x11.XSetErrorHandler.restype = ctypes.c_void_p
    # other programs' windows may close while they are queried; by default that ends this process
    before = x11.XSetErrorHandler(_IGNORE)
    try:
        x11.XDefaultRootWindow.restype = ctypes.c_ulong
        root = x11.XDefaultRootWindow(handle)
        window = _own_window(x11, handle, root)
        if window is None:
            return False
        # the toolkit drops presses whose time is not after that of the same key's last one; X servers count like this
        now = int(1000 * time.monotonic()) & 0xFFFFFFFF
        for number, key in enumerate(keys):
            if key is None:
                draw = InputEvent(type=EXPOSE, display=display, window=window)
                x11.XSendEvent(handle, ctypes.c_ulong(window), 0, ctypes.c_long(EXPOSURE_MASK), ctypes.byref(draw))
                continue
            keycode, down, shift = key
            kind, mask = (_KEY_PRESS, 1) if down else (_KEY_RELEASE, 2)
            event = InputEvent(
                type=kind, display=display, window=window, root=root, code=keycode, same_screen=1,
                time=now + number, state=_SHIFT if shift else 0,
            )  # fmt: skip
            x11.XSendEvent(handle, ctypes.c_ulong(window), 1, ctypes.c_long(mask), ctypes.byref(event))
    finally:
        x11.XSync(handle, 0)
        x11.XSetErrorHandler(ctypes.c_void_p(before))
        x11.XCloseDisplay(handle)
    return True


def _own_window(x11: Any, display: ctypes.c_void_p, root: int) -> int | None:
    """The window below `root` whose _NET_WM_PID is this process."""
    atom = ctypes.c_ulong(x11.XInternAtom(display, b"_NET_WM_PID", 0))
    focus, revert = ctypes.c_ulong(), ctypes.c_int()
    x11.XGetInputFocus(display, ctypes.byref(focus), ctypes.byref(revert))
    waiting = [root, focus.value]  # the focused window first: it usually is the one
    while waiting:
        window = waiting.pop()
        if window <= 1:  # None and PointerRoot are not windows
            continue
        if _pid(x11, display, window, atom) == os.getpid():
            return window
        waiting += _children(x11, display, window)
    return None


def _pid(x11: Any, display: ctypes.c_void_p, window: int, atom: ctypes.c_ulong) -> int | None:
    kind, form = ctypes.c_ulong(), ctypes.c_int()
    count, left, data = ctypes.c_ulong(), ctypes.c_ulong(), ctypes.POINTER(ctypes.c_ulong)()
    x11.XGetWindowProperty(
        display, ctypes.c_ulong(window), atom, ctypes.c_long(0), ctypes.c_long(1), 0, ctypes.c_ulong(6),  # XA_CARDINAL
        ctypes.byref(kind), ctypes.byref(form), ctypes.byref(count), ctypes.byref(left), ctypes.byref(data),
    )  # fmt: skip
    if not data:
        return None
    found = int(data[0]) if count.value else None
    x11.XFree(data)
    return found


def _children(x11: Any, display: ctypes.c_void_p, window: int) -> list[int]:
    root, parent, children, count = (
        ctypes.c_ulong(),
        ctypes.c_ulong(),
        ctypes.POINTER(ctypes.c_ulong)(),
        ctypes.c_uint(),
    )
    if not x11.XQueryTree(
        display, ctypes.c_ulong(window), ctypes.byref(root), ctypes.byref(parent), ctypes.byref(children),
        ctypes.byref(count),
    ):  # fmt: skip
        return []
    found = [int(children[number]) for number in range(count.value)]
    if children:
        x11.XFree(children)
    return found
