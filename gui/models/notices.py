"""Notices: what the window reports without stopping the user's work."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from v3studio.gui.models.stage_rows import message_text
from v3studio.studio.errors import StudioError

SHOWN_SECONDS = 12.0
"""Least time that a notice is shown; longer ones stay longer. Failures stay until they are dismissed."""

SECONDS_PER_LETTER = 0.08

MOST_FAILURES = 20  # failures that are kept; older ones are dropped


@dataclass(frozen=True)
class Notice:
    """A message, maybe of several lines, and the file or folder written, if any. A success of its topic removes it."""

    text: str
    bad: bool
    path: Path | None
    topic: str
    until: float  # when it goes, by the clock of `Notices`

    @property
    def line(self) -> str:
        return " ".join(self.text.split())

    def replaces(self, other: Notice) -> bool:
        """Whether an earlier notice goes: a failure replaces the same one, and that its action is in progress; remarks,
        and what was written, replace each other."""
        if self.bad and other.bad:
            return self.text == other.text
        if self.bad:
            return other.path is None and other.topic == self.topic != ""
        return not other.bad and (self.path is None) == (other.path is None)


class Notices:
    """Passing remarks are shown for a while in the status line. What was written, which has buttons, is shown for a
    while over the view; failures are shown there until they are dismissed. The newest is in front."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._all: list[Notice] = []  # the newest last, also those that are not shown any more

    def show(
        self, text: str, bad: bool = False, path: Path | None = None, topic: str = "", stays: bool = False
    ) -> None:
        """Show a notice; see `Notice`. What was written stays until it is dismissed if `stays`."""
        shown = max(SHOWN_SECONDS, SECONDS_PER_LETTER * len(text))
        until = math.inf if bad or (stays and path is not None) else self._now() + shown
        notice = Notice(text.strip(), bad, path, topic, until)
        before = [other for other in self._all if not notice.replaces(other)]
        dropped = [other for other in before if other.bad][: 1 - MOST_FAILURES] if bad else []
        self._all = [*(other for other in before if other not in dropped), notice]

    def clear(self, topic: str) -> None:
        """Remove the failures and remarks of a topic. What was written before stays as long as it would."""
        self._all = [notice for notice in self._all if notice.topic != topic or notice.path is not None]

    def outcome(self, topic: str, problem: str) -> bool:
        """Show a failure, or remove those of the topic if there is none (""); returns whether there is none."""
        if problem:
            self.show(problem, bad=True, topic=topic)
        else:
            self.clear(topic)
        return not problem

    @contextmanager
    def reporting(self, topic: str) -> Iterator[None]:
        """Show a StudioError or OSError that is raised within as a failure; see `outcome`."""
        problem = ""
        try:
            yield
        except (StudioError, OSError) as error:
            problem = message_text(error) if isinstance(error, StudioError) else str(error)
        self.outcome(topic, problem)

    def dismiss(self) -> bool:
        """Remove the notice over the view; returns whether there was one."""
        card = self.card
        if card is not None:
            self._all.remove(card)
        return card is not None

    @property
    def _shown(self) -> list[Notice]:
        return [notice for notice in self._all if self._now() < notice.until]

    @property
    def _cards(self) -> list[Notice]:
        return [notice for notice in self._shown if notice.bad or notice.path is not None]

    @property
    def card(self) -> Notice | None:
        """The notice that is shown over the view, with buttons; None if there is none."""
        return next(reversed(self._cards), None)

    @property
    def more(self) -> int:
        """Number of notices behind the one over the view."""
        return max(len(self._cards) - 1, 0)

    @property
    def line(self) -> str:
        """The remark in the status line; "" if there is none."""
        return next((notice.line for notice in self._shown if not notice.bad and notice.path is None), "")

    @property
    def text(self) -> str:
        """The newest notice that is shown, in one line; "" if there is none."""
        return next((notice.line for notice in reversed(self._shown)), "")
