"""Requests to close the window, as opposed to presses of the Escape key."""

import time
from collections.abc import Callable

WAIT = 0.4
"""Seconds to wait before a close request takes effect, since it may have been Escape."""

TICKS = 3
"""Ticks to wait as well: on a slow machine, the toolkit may not have looked for the release of the key by then."""

RELEASE = 5.0
"""Seconds within which the release of an Escape that was seen pressed may request a close of its own."""


class CloseRequests:
    """Tells close requests from Escape: Open3D also requests a close when Escape is pressed and when it is released,
    before it reports the key (which it does not do while text is edited). A single request is a real one, unless the
    key was down.

    Args:
        escape_down: whether the Escape key is pressed now; False where that is unknown.

    Attributes:
        granted: whether the window may close.
    """

    def __init__(self, escape_down: Callable[[], bool] = lambda: False) -> None:
        self.granted = False
        self._escape_down = escape_down
        self._asked: list[float] = []
        self._ticks = 0
        self._pressed = False
        self._released_until = 0.0

    def asked(self) -> bool:
        """Handle a close request of the toolkit; return whether the window may close."""
        self._asked.append(time.monotonic())
        self._ticks = 0
        self._pressed |= self._escape_down()
        return self.granted

    def ask(self) -> None:
        """Request a close from the menu."""
        self._asked, self._ticks, self._pressed = [time.monotonic() - WAIT], TICKS, False

    def escape(self) -> None:
        """Handle Escape: drop the requests that it caused."""
        self._asked.clear()
        self._pressed, self._released_until = False, 0.0

    def due(self) -> bool:
        """True once for each real request; call at each tick."""
        self._ticks += 1
        if not self._asked or self._ticks < TICKS or time.monotonic() < self._asked[-1] + WAIT or self._escape_down():
            return False
        alone, release = len(self._asked) == 1, self._asked[-1] < self._released_until
        self._released_until = self._asked[-1] + RELEASE if alone and self._pressed else 0.0
        real = alone and not self._pressed and not release
        self._asked.clear()
        self._pressed = False
        return real
