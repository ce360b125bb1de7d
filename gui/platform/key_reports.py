"""Which reports of pressed keys are of presses that have not been reported yet.

The toolkit has been seen to report one press twice on a busy machine, which would jump over two groups instead of one.
"""

from __future__ import annotations

SETTLED = 30
"""Ticks after a press in which a report without a press of its own is another one of the same press."""


class KeyReports:
    """See the module. Call `tick` at each tick.

    Attributes:
        passed, again: number of presses passed on to the toolkit, and of reports that were dropped, for bug reports.
    """

    def __init__(self) -> None:
        self.passed = self.again = 0
        self._tick = 0
        self._unheard: list[int] = []  # ticks of the presses that were passed on
        self._last = -SETTLED

    def tick(self) -> None:
        """Note that the window has ticked."""
        self._tick += 1
        while self._unheard and self._tick >= self._unheard[0] + SETTLED:
            del self._unheard[0]  # a text field kept it

    def press(self) -> None:
        """Note a press, or a repeat of a key that is held, that is passed on to the toolkit."""
        self.passed += 1
        self._unheard.append(self._tick)
        self._last = self._tick

    def is_new(self) -> bool:
        """Note that the toolkit reports a press; returns whether it is to be acted on.

        Presses that did not come through here, as with the pointer outside of the window, are: long after the last one
        that did.
        """
        if self._unheard:
            del self._unheard[0]
            return True
        if self._tick >= self._last + SETTLED:
            return True
        self.again += 1
        return False
