"""The screen's size and density, asked of X before the window is made."""

from __future__ import annotations

import ctypes
import ctypes.util
import re

USUAL_DPI = 96.0
SHARE = 0.95
"""Of the screen, at most, that a window takes on each axis: borders and panels need the rest."""


def fitting_size(size: tuple[int, int]) -> tuple[int, int]:
    """Pixels for a window that is `size` on a screen of the usual density: more where pixels are small, as the toolkit
    makes its letters larger there but not its windows; never more than the screen has."""
    screen = _screen()
    if screen is None:
        return size
    width, height, resources = screen
    scale = scale_of(resources)
    return (
        min(round(size[0] * scale), max(round(width * SHARE), size[0])),
        min(round(size[1] * scale), max(round(height * SHARE), size[1])),
    )


def scale_of(resources: str) -> float:
    """How many times larger than usual letters are, by X's resources (`Xft.dpi`)."""
    found = re.search(r"^Xft\.dpi:\s*([0-9.]+)\s*$", resources, re.MULTILINE)
    try:
        return max(float(found[1]) / USUAL_DPI, 1.0) if found else 1.0
    except ValueError:
        return 1.0


def _screen() -> tuple[int, int, str] | None:
    """Width, height and resources of the X screen; None where there is no X."""
    name = ctypes.util.find_library("X11")
    if name is None:
        return None
    x11 = ctypes.CDLL(name)
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XOpenDisplay.argtypes = [ctypes.c_char_p]
    x11.XResourceManagerString.restype = ctypes.c_char_p
    for function in (x11.XResourceManagerString, x11.XDefaultScreen, x11.XCloseDisplay):
        function.argtypes = [ctypes.c_void_p]
    for function in (x11.XDisplayWidth, x11.XDisplayHeight):
        function.argtypes = [ctypes.c_void_p, ctypes.c_int]
    display = x11.XOpenDisplay(None)
    if not display:
        return None
    try:
        number = x11.XDefaultScreen(display)
        resources = (x11.XResourceManagerString(display) or b"").decode("utf-8", "replace")
        return x11.XDisplayWidth(display, number), x11.XDisplayHeight(display, number), resources
    finally:
        x11.XCloseDisplay(display)
