"""Requests to close the window, as opposed to presses of the Escape key."""

import time
from collections.abc import Callable

WAIT = 0.4  # seconds to wait before a close request takes effect, since it may have been Escape
TICKS = 3  # ticks to wait as well, after Escape is up: the toolkit has handled its release by then


class CloseRequests:
    """Tells close requests from Escape: Open3D also requests a close when Escape is pressed and when it is released,
    before it reports the key (which it does not do while text is edited, or a mouse button is pressed on a widget).
    A single request is a real one, unless it may be of Escape. `escape`: whether Escape is pressed, or the toolkit got
    its press or release just now; False where unknown. `granted`: whether the window may close. `wanted`: whether it is
    to be closed after the tick: Open3D crashes if it is closed within one.
    """

    def __init__(self, escape: Callable[[], bool]) -> None:
        self.granted = self.wanted = False
        self._escape = escape
        self._asked: list[float] = []
        self._ticks = 0
        self._pressed = False

    def asked(self) -> bool:
        """Handle a close request of the toolkit; return whether the window may close."""
        self._asked.append(time.monotonic())
        self._ticks = 0
        self._pressed |= self._escape()
        return self.granted

    def ask(self) -> None:
        """Request a close from the menu."""
        self._asked, self._ticks, self._pressed = [time.monotonic() - WAIT], TICKS, False

    def escape(self) -> None:
        """Handle Escape: drop the requests that it caused."""
        self._asked.clear()
        self._pressed = False

    def due(self) -> bool:
        """True once for each real request; call at each tick."""
        if not self._asked:
            return False
        self._ticks = 0 if self._escape() else self._ticks + 1
        if self._ticks < TICKS or time.monotonic() < self._asked[-1] + WAIT:
            return False
        real = len(self._asked) == 1 and not self._pressed
        self.escape()
        return real
