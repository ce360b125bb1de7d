"""Shows a run that goes on elsewhere: in the background, in another terminal, or on a cluster."""

from __future__ import annotations

import time
from collections.abc import Callable

from pipelines.events import Event, RunFinished, RunStarted
from pipelines.events.log_follower import LogFollower
from pipelines.takes.take import Take
from studio.errors import Cancelled, StudioError

_LOOK = 0.3
_GONE_SECONDS = 3.0
"""How long a run may be gone before its last event must be in the log."""


def attach(take: Take, show: Callable[[Event], None]) -> None:
    """Show the events of the run in progress, from its beginning, until it ends.

    Args:
        take: the take.
        show: receives the events.

    Raises:
        StudioError: no run is in progress (`take.no_run`), it failed (with the code of its error), or it was killed
            (`run.lost`).
        Cancelled: it was cancelled.
    """
    holder = take.running()
    if holder is None:
        raise StudioError("take.no_run", "no run is in progress", file=take.root, fix=_RUNS)
    follower, log = LogFollower(take.log), _Log()
    gone: float | None = None
    while True:
        anew, events = follower.poll()
        now = take.running()
        if now is not None and (anew or "pid" not in holder):
            holder = now
        if anew:
            log = _Log()
        for event in log.of_run(events, holder.get("pid"), ended=now is None):
            show(event)
            if isinstance(event, RunFinished):
                _end(event)
                return
        if now is not None:
            gone = None
        elif gone is None:
            gone = time.monotonic()
        elif time.monotonic() - gone > _GONE_SECONDS:
            if log.own:
                raise StudioError(
                    "run.lost",
                    "the run was killed",
                    file=take.root,
                    fix="Start it again: it continues where it stopped.",
                )
            name = holder.get("command", "the process that held the take")
            raise StudioError("take.no_run", f"{name} ended before it reported anything", file=take.root, fix=_RUNS)
        time.sleep(_LOOK)


class _Log:
    """A log that may be of an earlier run: a run locks the take before it replaces the log, and other commands that
    lock the take write none.

    Attributes:
        own: whether it is of the run in progress; None while that is unknown.
    """

    def __init__(self) -> None:
        self.own: bool | None = None
        self._unsure: list[Event] = []

    def of_run(self, events: list[Event], pid: object, ended: bool) -> list[Event]:
        """Those of new events, and of earlier ones, that are now known to be of the run.

        Args:
            events: new in the log.
            pid: of the run; None while it is unknown.
            ended: the run does not hold the take any longer.
        """
        self._unsure += events
        if self.own is None:
            started = next((event for event in self._unsure if isinstance(event, RunStarted)), None)
            finished = any(isinstance(event, RunFinished) for event in self._unsure)
            if finished and not ended:  # a run reports its end after it has released the take
                self.own = False
            elif started is not None and pid is not None:
                self.own = started.pid == pid
            elif finished and started is None:  # it failed before it began, for example without its footage
                self.own = True
        if self.own is None:
            return []
        known, self._unsure = self._unsure, []
        return known if self.own else []


def _end(event: RunFinished) -> None:
    if event.outcome == "cancelled":
        raise Cancelled
    if event.outcome == "failed":
        raise StudioError(event.code or "run.failed", event.message)


_RUNS = "`v3studio status` shows the results; `v3studio run` starts one."
