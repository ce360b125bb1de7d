"""Presses of the Escape key: each does one thing, whether or not the toolkit reports it.

The toolkit keeps a press to itself if a text field takes it, and has been seen to report one twice on a busy machine.
"""

from __future__ import annotations

ESCAPE = 9
"""X key code, the same on all Linux systems."""

PATIENCE = 10
"""Ticks within which the toolkit reports a press, if it does."""

SETTLED = 30
"""Ticks after a press or its release in which a report without a press of its own is another one of the same press."""


class Escapes:
    """See the module. Call `tick` at each tick.

    Attributes:
        dialog: whether a dialog is open; the window sets it.
    """

    def __init__(self) -> None:
        self.dialog = False
        self._tick = 0
        self._unheard: list[tuple[int, bool]] = []  # presses passed on to the toolkit: tick, whether a dialog was open
        self._last = -SETTLED

    def tick(self) -> None:
        """Note that the window has ticked."""
        self._tick += 1
        while self._unheard and self._tick >= self._unheard[0][0] + SETTLED:
            del self._unheard[0]  # kept by a text field outside of dialogs

    def pressed(self) -> None:
        """Note a press that is passed on to the toolkit; not the repeats of a key that is held."""
        self._unheard.append((self._tick, self.dialog))
        self._last = self._tick

    def released(self) -> None:
        """Note a release that is passed on to the toolkit."""
        self._last = self._tick

    def heard(self, again: bool) -> bool:
        """Note that the toolkit reports a press; returns whether it is one that nothing was done about.

        Args:
            again: whether the key was down already, as far as the toolkit has told. Presses that did not come through
                here, as with the pointer outside of the window, are told apart by it.
        """
        if self._unheard:
            del self._unheard[0]
            return True
        return not again and self._tick >= self._last + SETTLED

    def kept(self) -> bool:
        """Whether the toolkit has kept a press in the open dialog to itself; True once for each press. Without a dialog
        nobody would act on it, and a report that comes late still counts."""
        late = self._tick - PATIENCE
        due = [number for number, (tick, within) in enumerate(self._unheard) if within and tick <= late]
        if not self.dialog or not due:
            return False
        del self._unheard[due[0]]
        self._last = self._tick
        return True
