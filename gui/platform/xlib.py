"""Xlib: the functions that the window calls, with their types, and events."""

import ctypes
import ctypes.util
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

EXPOSE, EXPOSURE_MASK = 12, 1 << 15  # an event that asks a window to be drawn, and its mask
ESCAPE = 9  # X key code, the same on all Linux systems
_POINTER, _NUMBER, _INT, _UINT, _LONG = ctypes.c_void_p, ctypes.c_ulong, ctypes.c_int, ctypes.c_uint, ctypes.c_long
_TYPES: dict[str, tuple[Any, ...]] = {
    "XOpenDisplay": (_POINTER, ctypes.c_char_p),
    "XCloseDisplay": (_INT, _POINTER),
    "XSync": (_INT, _POINTER, _INT),
    "XFlush": (_INT, _POINTER),
    "XPending": (_INT, _POINTER),
    "XFree": (_INT, _POINTER),
    "XSetErrorHandler": (_POINTER, _POINTER),
    "XDefaultScreen": (_INT, _POINTER),
    "XDisplayWidth": (_INT, _POINTER, _INT),
    "XDisplayHeight": (_INT, _POINTER, _INT),
    "XResourceManagerString": (ctypes.c_char_p, _POINTER),
    "XDefaultRootWindow": (_NUMBER, _POINTER),
    "XInternAtom": (_NUMBER, _POINTER, ctypes.c_char_p, _INT),
    "XQueryTree": (_INT, _POINTER, _NUMBER, *[_POINTER] * 4),
    "XQueryPointer": (_INT, _POINTER, _NUMBER, *[_POINTER] * 7),
    "XQueryKeymap": (_INT, _POINTER, ctypes.c_char_p),
    "XGetWMNormalHints": (_INT, _POINTER, _NUMBER, _POINTER, _POINTER),
    "XSetWMNormalHints": (_INT, _POINTER, _NUMBER, _POINTER),
    "XGetWindowProperty": (_INT, _POINTER, _NUMBER, _NUMBER, _LONG, _LONG, _INT, _NUMBER, *[_POINTER] * 5),
    "XChangeProperty": (_INT, _POINTER, _NUMBER, _NUMBER, _NUMBER, _INT, _INT, ctypes.c_char_p, _INT),
    "XCreateSimpleWindow": (_NUMBER, _POINTER, _NUMBER, _INT, _INT, _UINT, _UINT, _UINT, _NUMBER, _NUMBER),
    "XCreateWindow": (
        _NUMBER, _POINTER, _NUMBER, _INT, _INT, _UINT, _UINT, _UINT, _INT, _UINT, _POINTER, _NUMBER, _POINTER,
    ),
    "XMapRaised": (_INT, _POINTER, _NUMBER),
    "XSelectInput": (_INT, _POINTER, _NUMBER, _LONG),
    "XNextEvent": (_INT, _POINTER, _POINTER),
    "XSendEvent": (_INT, _POINTER, _NUMBER, _INT, _LONG, _POINTER),
    "XKeysymToKeycode": (ctypes.c_ubyte, _POINTER, _NUMBER),
    "XKeycodeToKeysym": (_NUMBER, _POINTER, ctypes.c_ubyte, _INT),
    "XLookupKeysym": (_NUMBER, _POINTER, _INT),
    "XkbSetDetectableAutoRepeat": (_INT, _POINTER, _INT, _POINTER),
    "XSetSelectionOwner": (_INT, _POINTER, _NUMBER, _NUMBER, _NUMBER),
    "XGetSelectionOwner": (_NUMBER, _POINTER, _NUMBER),
    "XConvertSelection": (_INT, _POINTER, *[_NUMBER] * 5),
}  # fmt: skip
"""Type of the result and of the arguments."""

_IGNORE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER)(lambda _display, _error: 0)


class Connection:
    """Xlib, and a connection to the X server of DISPLAY unless it is not `wanted`. Without X, nothing has an effect."""

    def __init__(self, wanted: bool = True) -> None:
        self._x: Any = None
        self._display: Any = None
        name = ctypes.util.find_library("X11") if wanted and os.environ.get("DISPLAY") else None
        if name is not None:
            self._x = ctypes.CDLL(name)
            for function, (result, *arguments) in _TYPES.items():
                getattr(self._x, function).restype, getattr(self._x, function).argtypes = result, arguments
            self._display = self._x.XOpenDisplay(None)

    def close(self) -> None:
        if self._display:
            self._x.XCloseDisplay(self._display)
            self._display = None


@contextmanager
def errors_ignored(x: Any, display: Any) -> Iterator[None]:
    """Within the block, errors of the X server do not end the process. `x`: Xlib. `display`: the connection, if any."""
    if not display:
        yield
        return
    before = x.XSetErrorHandler(ctypes.cast(_IGNORE, ctypes.c_void_p))
    try:
        yield
        x.XSync(display, 0)
    finally:
        x.XSetErrorHandler(before)


class InputEvent(ctypes.Structure):
    """XKeyEvent, XButtonEvent and XMotionEvent of Xlib.h, which begin alike; `code` is the key code or the button."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        *((name, ctypes.c_ulong) for name in ("window", "root", "subwindow", "time")),
        *((name, ctypes.c_int) for name in ("x", "y", "x_root", "y_root")),
        ("state", ctypes.c_uint),
        ("code", ctypes.c_uint),
        ("same_screen", ctypes.c_int),
        ("padding", ctypes.c_long * 24),  # XEvent, which is copied as a whole, is larger
    )
