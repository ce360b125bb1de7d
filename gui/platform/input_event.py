"""An input event of X as a C structure, to be sent and received."""

from __future__ import annotations

import ctypes


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
