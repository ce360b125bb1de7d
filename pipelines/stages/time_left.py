"""The time left of a stage or of a run, as a countdown that does not jump."""

from __future__ import annotations

import math

_SHARE = 0.1
"""Time constant of corrections as a share of the time left: a correction is mostly made after a tenth of the rest."""

_EARLY = 0.25
"""The same at first, as a share of the time since the first estimate."""

_LEAST_SECONDS = 5.0
"""Shortest time constant."""


class Countdown:
    """Seconds left: decreases with the clock and moves smoothly toward new estimates.

    Single steps that take unusually long, and estimates that change when a new kind of step is measured for the first
    time, change an estimate at once. Shown directly, it jumps up and down, so the difference between an estimate and
    the countdown is corrected exponentially over time.
    """

    def __init__(self) -> None:
        self._left: float | None = None
        self._at = self._began = 0.0

    def estimate(self, now: float, seconds: float) -> float:
        """Take in an estimate.

        Args:
            now: seconds on any clock that does not run backwards.
            seconds: estimated seconds left at `now`.

        Returns:
            The countdown at `now`.
        """
        expected = self.at(now)
        if expected is None:
            self._left, self._began = seconds, now
        else:
            # the first estimates are the least certain, so they are corrected faster
            constant = max(_LEAST_SECONDS, min(_EARLY * (now - self._began), _SHARE * min(expected, seconds)))
            self._left = expected + (1 - math.exp(-(now - self._at) / constant)) * (seconds - expected)
        self._at = now
        return self._left

    def at(self, now: float) -> float | None:
        """Seconds left at `now` if nothing has changed; None before the first estimate."""
        return None if self._left is None else max(0.0, self._left - (now - self._at))
