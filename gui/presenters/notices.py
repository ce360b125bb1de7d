"""Notices: sentences that are shown for a while and never stop the user's work."""

from __future__ import annotations

import time
from collections.abc import Callable

SHOWN_SECONDS = 12.0
"""Least time that a notice is shown; longer ones stay longer."""

SECONDS_PER_LETTER = 0.08


class Notices:
    """The newest notice, shown in the status line.

    Args:
        now: a clock in seconds that never runs backwards.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._text, self._bad, self._until = "", False, 0.0

    def tell(self, text: str, bad: bool = False) -> None:
        """Show a notice in place of an earlier one.

        Args:
            text: the sentence; line breaks become spaces.
            bad: whether something failed.
        """
        self._text, self._bad = " ".join(text.split()), bad
        self._until = self._now() + max(SHOWN_SECONDS, SECONDS_PER_LETTER * len(text))

    def clear(self) -> None:
        """Remove the notice."""
        self._text = ""

    @property
    def text(self) -> str:
        """The notice; "" if there is none."""
        return self._text if self._now() < self._until else ""

    @property
    def bad(self) -> bool:
        """Whether the notice tells of a failure."""
        return self._bad and self.text != ""
