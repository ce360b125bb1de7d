"""Requests to close the window: which are meant, and which are the Escape key."""

from __future__ import annotations

import time

WAIT = 0.4
"""Seconds to wait whether a request to close was Escape."""


class CloseRequests:
    """Open3D asks to close at Escape too, when it is pressed and when it is released, before it tells of the key (of
    which it does not tell while a text is being edited). A request that stays alone is meant.

    Attributes:
        granted: the window may close.
    """

    def __init__(self) -> None:
        self.granted = False
        self._asked: list[float] = []

    def asked(self) -> bool:
        """The toolkit asks; returns whether it may close."""
        self._asked.append(time.monotonic())
        return self.granted

    def ask(self) -> None:
        """A person asks, by the menu."""
        self._asked = [time.monotonic() - WAIT]

    def escape(self) -> None:
        """It was Escape."""
        self._asked.clear()

    def due(self) -> bool:
        """True once for each request that was meant; call at each tick."""
        if not self._asked or time.monotonic() < self._asked[-1] + WAIT:
            return False
        alone = len(self._asked) == 1
        self._asked.clear()
        return alone
