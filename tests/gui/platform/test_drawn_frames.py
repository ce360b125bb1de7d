"""Frames that reach the screen are told, on a real X server."""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Iterator
from typing import Any

import pytest

from gui.platform.drawn_frames import DrawnFrames
from tests.support.waiting import wait_until


class Painter:
    """Another program's window, and something that is painted in it."""

    def __init__(self) -> None:
        x: Any = ctypes.CDLL(ctypes.util.find_library("X11"))
        handle, number = ctypes.c_void_p, ctypes.c_ulong
        x.XOpenDisplay.restype, x.XOpenDisplay.argtypes = handle, [ctypes.c_char_p]
        for name in ("XDefaultRootWindow", "XCreateSimpleWindow"):
            getattr(x, name).restype = number
        x.XDefaultRootWindow.argtypes = [handle]
        whole = [ctypes.c_int] * 2 + [ctypes.c_uint] * 3 + [number] * 2
        x.XCreateSimpleWindow.argtypes = [handle, number, *whole]
        x.XCreateGC.restype, x.XCreateGC.argtypes = handle, [handle, number, number, handle]
        x.XFillRectangle.argtypes = [handle, number, handle, *[ctypes.c_int] * 2, *[ctypes.c_uint] * 2]
        x.XMapWindow.argtypes = x.XDestroyWindow.argtypes = [handle, number]
        x.XSync.argtypes = [handle, ctypes.c_int]
        x.XCloseDisplay.argtypes = [handle]
        self._x, self._display = x, x.XOpenDisplay(None)
        root = x.XDefaultRootWindow(self._display)
        self.window = int(x.XCreateSimpleWindow(self._display, root, 0, 0, 60, 40, 0, 0, 0))
        x.XMapWindow(self._display, self.window)
        self._gc = x.XCreateGC(self._display, self.window, 0, None)
        x.XSync(self._display, 0)

    def paint(self) -> None:
        self._x.XFillRectangle(self._display, self.window, self._gc, 5, 5, 20, 20)
        self._x.XSync(self._display, 0)

    def destroy(self) -> None:
        self._x.XDestroyWindow(self._display, self.window)
        self._x.XSync(self._display, 0)

    def close(self) -> None:
        self._x.XCloseDisplay(self._display)


@pytest.fixture
def painter(display: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Painter]:
    monkeypatch.setenv("DISPLAY", display)
    found = Painter()
    yield found
    found.close()


def test_each_frame_is_told_once(painter: Painter) -> None:
    frames = DrawnFrames(painter.window)
    assert frames.active
    while frames.poll():  # the window's own appearance
        pass
    for _ in range(3):
        assert not frames.poll()
        painter.paint()
        painter.paint()
        wait_until("a frame", frames.poll)
        assert not frames.poll()
    frames.close()
    assert not frames.poll()


def test_a_window_that_is_gone_tells_nothing_and_harms_nobody(painter: Painter) -> None:
    frames = DrawnFrames(painter.window)
    painter.paint()
    painter.destroy()
    frames.poll()
    assert not frames.poll()
    frames.close()
    late = DrawnFrames(painter.window)
    assert not late.poll()
    late.close()


def test_without_the_extension_nothing_is_told(painter: Painter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None if name == "Xdamage" else "libX11.so.6")
    frames = DrawnFrames(painter.window)
    painter.paint()
    assert not frames.active
    assert not frames.poll()
    frames.close()
    assert not DrawnFrames(None).active
