"""Requests to close the window, as opposed to presses of the Escape key."""

from __future__ import annotations

import time

WAIT = 0.4
"""Seconds to wait before a close request takes effect, since it may have been Escape."""


class CloseRequests:
    """Tells close requests from Escape: Open3D also requests a close when Escape is pressed and when it is released,
    before it reports the key (which it does not do while text is edited). A single request is a real one.

    Attributes:
        granted: whether the window may close.
    """

    def __init__(self) -> None:
        self.granted = False
        self._asked: list[float] = []

    def asked(self) -> bool:
        """Handle a close request of the toolkit; return whether the window may close."""
        self._asked.append(time.monotonic())
        return self.granted

    def ask(self) -> None:
        """Request a close from the menu."""
        self._asked = [time.monotonic() - WAIT]

    def escape(self) -> None:
        """Handle Escape: drop the requests that it caused."""
        self._asked.clear()

    def due(self) -> bool:
        """True once for each real request; call at each tick."""
        if not self._asked or time.monotonic() < self._asked[-1] + WAIT:
            return False
        alone = len(self._asked) == 1
        self._asked.clear()
        return alone
