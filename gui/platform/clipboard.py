"""The clipboard of X11, which the toolkit's Python interface does not offer.

Copied text is kept by this process: the program that pastes asks for it, and `poll` answers (ICCCM, section 2). So it
is lost when the window is closed, unless the desktop has a clipboard manager.
"""

import ctypes

from v3studio.gui.platform.xlib import Connection, errors_ignored

_SELECTION_CLEAR, _SELECTION_REQUEST, _SELECTION_NOTIFY = 29, 30, 31
_ATOM = 4
_LONGEST = 1 << 18  # longest text that is read, bytes

_Event = ctypes.c_ulong * 24
"""XEvent. Each field of XSelectionEvent and XSelectionRequestEvent takes the place of a long, also the int `type`."""


class Clipboard(Connection):
    """Puts text on the clipboard. Call `poll` at each tick. What was copied is gone after `close`."""

    def __init__(self) -> None:
        super().__init__()
        self._text: bytes | None = None
        x = self._x
        if not self._display:
            return
        self._window = x.XCreateSimpleWindow(self._display, x.XDefaultRootWindow(self._display), 0, 0, 1, 1, 0, 0, 0)
        names = ("CLIPBOARD", "UTF8_STRING", "TARGETS", "V3_STUDIO_PASTE")
        self._clipboard, self._utf8, self._targets, self._place = (
            x.XInternAtom(self._display, name.encode(), 0) for name in names
        )

    def copy(self, text: str) -> bool:
        """Put text on the clipboard; returns whether that worked."""
        if not self._display:
            return False
        self._text = text.encode(errors="surrogateescape")  # paths need not be UTF-8
        self._x.XSetSelectionOwner(self._display, self._clipboard, self._window, 0)
        return bool(self._x.XGetSelectionOwner(self._display, self._clipboard) == self._window)

    def ask(self) -> bool:
        """Ask for the text on the clipboard; `poll` returns it. Returns whether there is a clipboard."""
        if not self._display:
            return False
        self._x.XConvertSelection(self._display, self._clipboard, self._utf8, self._place, self._window, 0)
        self._x.XFlush(self._display)
        return True

    def poll(self) -> str | None:
        """Answer other programs; return the text asked for: "" if the clipboard has none, None if it has not come."""
        text = None
        if not self._display:
            return None
        while self._x.XPending(self._display):
            event = _Event()
            self._x.XNextEvent(self._display, ctypes.byref(event))
            kind = event[0] & 0xFFFFFFFF
            if kind == _SELECTION_CLEAR:
                self._text = None
            elif kind == _SELECTION_REQUEST:
                self._answer(*event[5:10])
            elif kind == _SELECTION_NOTIFY:
                text = self._pasted() if event[7] else ""  # the property
        return text

    def _answer(self, requestor: int, selection: int, target: int, place: int, time: int) -> None:
        """Answer a request. `place`: its property."""
        x, display = self._x, self._display
        with errors_ignored(x, display):  # who asked may be gone
            place = place or target
            if self._text is None:
                place = 0
            elif target == self._targets:
                offered = (ctypes.c_ulong * 2)(self._targets, self._utf8)
                x.XChangeProperty(display, requestor, place, _ATOM, 32, 0, bytes(offered), 2)
            elif target == self._utf8:
                x.XChangeProperty(display, requestor, place, self._utf8, 8, 0, self._text, len(self._text))
            else:
                place = 0
            answer = _Event(_SELECTION_NOTIFY, 0, 0, display, requestor, selection, target, place, time)
            x.XSendEvent(display, requestor, 0, 0, ctypes.byref(answer))

    def _pasted(self) -> str:
        kind, size, count, rest = ctypes.c_ulong(), ctypes.c_int(), ctypes.c_ulong(), ctypes.c_ulong()
        data = ctypes.c_void_p()
        places = [ctypes.byref(place) for place in (kind, size, count, rest, data)]
        self._x.XGetWindowProperty(self._display, self._window, self._place, 0, _LONGEST // 4, 1, 0, *places)
        if not data.value:
            return ""
        text = ctypes.string_at(data.value, count.value) if size.value == 8 else b""
        self._x.XFree(data)
        return text.decode("utf-8", "replace")
