"""Notices: what the window reports without stopping the user's work."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from studio.errors import StudioError

SHOWN_SECONDS = 12.0
"""Least time that a notice is shown; longer ones stay longer. Failures stay until they are dismissed."""

SECONDS_PER_LETTER = 0.08

MOST_FAILURES = 20  # failures that are kept; older ones are dropped


@dataclass(frozen=True)
class Notice:
    """A message, maybe of several lines, and the file or folder written, if any. A success of its topic removes it."""

    text: str
    bad: bool = False
    path: Path | None = None
    topic: str = ""

    @property
    def line(self) -> str:
        return " ".join(self.text.split())


class Notices:
    """Passing remarks are shown for a while in the status line. What was written, which has buttons, is shown for a
    while over the view; failures are shown there until they are dismissed. The newest is in front."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._passing: Notice | None = None
        self._written: Notice | None = None
        self._until: dict[bool, float] = {}  # of what was written (True) and of remarks
        self._failures: list[Notice] = []
        self._covered = False  # a failure came after what was written
        self._newest: Notice | None = None

    def show(
        self, text: str, bad: bool = False, path: Path | None = None, topic: str = "", stays: bool = False
    ) -> None:
        """Show a notice; see `Notice`. A remark replaces an earlier remark, and what was written what was written
        before. What was written stays until it is dismissed if `stays`."""
        notice = self._newest = Notice(text.strip(), bad, path, topic)
        if bad:
            self._failures = [one for one in self._failures if one.text != notice.text][1 - MOST_FAILURES :]
            self._failures.append(notice)
            self._covered = True
            if self._passing is not None and topic and self._passing.topic == topic:
                self._passing = None  # what was in progress has failed
            return
        written = path is not None
        if written:
            self._written, self._covered = notice, False
        else:
            self._passing = notice
        shown = max(SHOWN_SECONDS, SECONDS_PER_LETTER * len(notice.text))
        self._until[written] = math.inf if written and stays else self._now() + shown

    def clear(self, topic: str) -> None:
        """Remove the failures and remarks of a topic. What was written before stays as long as it would."""
        left = [one for one in self._failures if one.topic != topic]
        self._covered &= left[-1:] == self._failures[-1:]
        self._failures = left
        if self._passing is not None and self._passing.topic == topic:
            self._passing = None

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
            problem = str(error)
        self.outcome(topic, problem)

    def dismiss(self) -> bool:
        """Remove the notice over the view; returns whether there was one."""
        card = self.card
        if card is None:
            return False
        if card.bad:
            self._failures.remove(card)
            self._covered = False
        else:
            self._written = None
        return True

    @property
    def passing(self) -> Notice | None:
        """The remark that is shown; None if there is none."""
        return self._passing if self._now() < self._until.get(False, 0.0) else None

    @property
    def written(self) -> Notice | None:
        """What was written lately; None if nothing was."""
        return self._written if self._now() < self._until.get(True, 0.0) else None

    @property
    def card(self) -> Notice | None:
        """What is shown over the view, with buttons; None if nothing is."""
        failure = self._failures[-1] if self._failures else None
        return failure if failure is not None and self._covered else self.written or failure

    @property
    def more(self) -> int:
        """Number of notices behind the one over the view."""
        return max(len(self._failures) + (self.written is not None) - 1, 0)

    @property
    def line(self) -> str:
        """What is shown in the status line; "" if nothing is."""
        passing = self.passing
        return passing.line if passing is not None else ""

    @property
    def text(self) -> str:
        """The newest notice that is shown, in one line; "" if there is none."""
        passing, card = self.passing, self.card
        shown = card if card is not None and card is self._newest else passing or card
        return shown.line if shown is not None else ""
