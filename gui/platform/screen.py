"""Size and density of the X screen, queried before the window is created."""

from __future__ import annotations

import ctypes
import ctypes.util
import re

USUAL_DPI = 96.0
SHARE = 0.95
"""Largest share of the screen that a window takes on each axis."""


def fitting_size(size: tuple[int, int]) -> tuple[int, int]:
    """Window size in pixels for `size` at 96 dpi: larger on dense screens, where the toolkit scales its font but not
    its windows; at most `SHARE` of the screen."""
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
    """Font scale relative to 96 dpi, from the X resources (`Xft.dpi`); at least 1."""
    found = re.search(r"^Xft\.dpi:\s*([0-9.]+)\s*$", resources, re.MULTILINE)
    try:
        return max(float(found[1]) / USUAL_DPI, 1.0) if found else 1.0
    except ValueError:
        return 1.0


def _screen() -> tuple[int, int, str] | None:
    """Width, height and resources of the X screen; None without X."""
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
