"""Tells when the window's content has reached the screen, through the DAMAGE extension of X.

The toolkit drops frames silently while it is busy with the last one. Without the extension (libXdamage), nothing
is known, and the window is drawn again and again to be sure (`gui.platform.redraw`).
"""

import ctypes
import ctypes.util

from gui.platform.xlib import Connection, InputEvent, errors_ignored

_REPORT_NON_EMPTY = 3  # XDamageReportNonEmpty: one event until the damage is subtracted


class DrawnFrames(Connection):
    """See the module. `window`: the X window of the toolkit; None for none, and then nothing is reported."""

    def __init__(self, window: int | None) -> None:
        name = ctypes.util.find_library("Xdamage")
        super().__init__(window is not None and name is not None)
        x, display = self._x, self._display
        if not display:
            return
        damage = ctypes.CDLL(name)
        handle, number, integers = ctypes.c_void_p, ctypes.c_ulong, ctypes.POINTER(ctypes.c_int)
        damage.XDamageQueryExtension.argtypes = [handle, integers, integers]
        damage.XDamageCreate.restype, damage.XDamageCreate.argtypes = number, [handle, number, ctypes.c_int]
        damage.XDamageSubtract.argtypes = [handle, number, number, number]
        first, errors = ctypes.c_int(), ctypes.c_int()
        if not damage.XDamageQueryExtension(display, ctypes.byref(first), ctypes.byref(errors)):
            self.close()
            return
        self._damage, self._kind = damage, first.value
        with errors_ignored(x, display):  # the window may be closed by now
            self._watched = damage.XDamageCreate(display, window, _REPORT_NON_EMPTY)

    def poll(self) -> bool:
        """Whether something has been drawn since the last call. Does not wait."""
        if not self._display:
            return False
        drawn, event = False, InputEvent()
        while self._x.XPending(self._display):
            self._x.XNextEvent(self._display, ctypes.byref(event))
            drawn |= event.type == self._kind
        if drawn:
            with errors_ignored(self._x, self._display):
                self._damage.XDamageSubtract(self._display, self._watched, 0, 0)
        return drawn
