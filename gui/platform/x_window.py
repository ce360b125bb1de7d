"""Functions of X that the toolkit lacks: a least size of the window, whether a mouse button is pressed, the screen."""

import ctypes
import os
from collections.abc import Iterator, Sequence

from v3studio.gui.platform.xlib import ESCAPE, EXPOSURE_MASK, Connection, InputEvent, errors_ignored

_MIN_SIZE = 1 << 4  # PMinSize
BUTTONS = 0x1F00  # bits of the mouse buttons in the state of X: Button1Mask to Button5Mask
_CARDINAL = 6


class SizeHints(ctypes.Structure):
    """XSizeHints."""

    _fields_ = (
        ("flags", ctypes.c_long),
        *((name, ctypes.c_int) for name in ("x", "y", "width", "height", "min_width", "min_height")),
        *((f"rest{number}", ctypes.c_int) for number in range(11)),
    )


class XDisplay(Connection):
    """The display and its window, where they are known."""

    @property
    def buttons(self) -> int:
        """The mouse buttons that are pressed, a bit for each; 0 without X."""
        if not self._display:
            return 0
        window, number, mask = ctypes.c_ulong(), ctypes.c_int(), ctypes.c_uint()
        root, unused = self._x.XDefaultRootWindow(self._display), ctypes.byref(number)
        places = (ctypes.byref(window), ctypes.byref(window), unused, unused, unused, unused)
        self._x.XQueryPointer(self._display, root, *places, ctypes.byref(mask))
        return mask.value & BUTTONS

    @property
    def escape_down(self) -> bool:
        """Whether the Escape key is pressed now; False without X."""
        if not self._display:
            return False
        keys = ctypes.create_string_buffer(32)
        self._x.XQueryKeymap(self._display, keys)
        return bool(keys.raw[ESCAPE // 8] >> ESCAPE % 8 & 1)

    @property
    def window(self) -> int | None:
        """This process's window; None without X."""
        with errors_ignored(self._x, self._display):
            return next(self._own_windows(), None)

    def set_least_size(self, width: int, height: int) -> None:
        """Ask the window manager to keep this process's windows this large at least, pixels."""
        with errors_ignored(self._x, self._display):  # windows of other programs come and go
            for window in self._own_windows():
                hints, supplied = SizeHints(), ctypes.c_long()
                self._x.XGetWMNormalHints(self._display, window, ctypes.byref(hints), ctypes.byref(supplied))
                hints.flags |= _MIN_SIZE
                hints.min_width, hints.min_height = width, height
                self._x.XSetWMNormalHints(self._display, window, ctypes.byref(hints))

    def _own_windows(self) -> Iterator[int]:
        """Windows of this process."""
        if not self._display:
            return
        atom = self._x.XInternAtom(self._display, b"_NET_WM_PID", 0)
        waiting = [self._x.XDefaultRootWindow(self._display)]
        while waiting:
            window = waiting.pop()
            if self._number(window, atom) == os.getpid():
                yield window
            waiting += self._children(window)

    def _number(self, window: int, atom: int) -> int | None:
        kind, size, count, rest = ctypes.c_ulong(), ctypes.c_int(), ctypes.c_ulong(), ctypes.c_ulong()
        data = ctypes.POINTER(ctypes.c_ulong)()
        places = [ctypes.byref(place) for place in (kind, size, count, rest, data)]
        self._x.XGetWindowProperty(self._display, window, atom, 0, 1, 0, _CARDINAL, *places)
        if not data:
            return None
        value = int(data[0]) if count.value else None
        self._x.XFree(data)
        return value

    def _children(self, window: int) -> list[int]:
        root, parent, count = ctypes.c_ulong(), ctypes.c_ulong(), ctypes.c_int()
        listed = ctypes.POINTER(ctypes.c_ulong)()
        places = [ctypes.byref(place) for place in (root, parent, listed, count)]
        if not self._x.XQueryTree(self._display, window, *places) or not listed:
            return []
        children = [int(listed[number]) for number in range(count.value)]
        self._x.XFree(listed)
        return children

    def send(self, window: int, events: Sequence[tuple[InputEvent, int]]) -> None:
        """Send events, each with its mask, to a window of this process."""
        root = self._x.XDefaultRootWindow(self._display)
        with errors_ignored(self._x, self._display):
            for event, mask in events:
                event.display, event.window, event.root = self._display, window, root
                self._x.XSendEvent(self._display, window, int(mask != EXPOSURE_MASK), mask, ctypes.byref(event))

    def keys_of(self, text: str) -> list[tuple[int, bool]] | None:
        """X key code, and whether Shift is held, for each character; None if the keyboard has no key for one."""
        keys = []
        for character in text:
            symbol = ord(character) if ord(character) < 256 else 0x01000000 + ord(character)
            code = self._x.XKeysymToKeycode(self._display, symbol) if self._display else 0
            symbols = [self._x.XKeycodeToKeysym(self._display, code, shift) for shift in (0, 1)] if code else []
            if symbol not in symbols:
                return None
            keys.append((code, symbols.index(symbol) == 1))
        return keys

    @property
    def screen(self) -> tuple[int, int, str] | None:
        """Width and height of the screen, pixels, and the X resources; None without X."""
        if not self._display:
            return None
        x, display = self._x, self._display
        number = x.XDefaultScreen(display)
        resources = (x.XResourceManagerString(display) or b"").decode("utf-8", "replace")
        return x.XDisplayWidth(display, number), x.XDisplayHeight(display, number), resources
