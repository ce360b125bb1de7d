"""Shows a run that goes on elsewhere: in the background, in another terminal, or on a cluster."""

from __future__ import annotations

import time
from collections.abc import Callable

from pipelines.events import Event, RunFinished
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
    if take.running() is None:
        raise StudioError(
            "take.no_run",
            "no run is in progress",
            file=take.root,
            fix="`v3studio status` shows the results; `v3studio run` starts one.",
        )
    follower = LogFollower(take.log)
    gone: float | None = None
    while True:
        for event in follower.poll()[1]:
            show(event)
            if isinstance(event, RunFinished):
                _end(event)
                return
        if take.running() is not None:
            gone = None
        elif gone is None:
            gone = time.monotonic()
        elif time.monotonic() - gone > _GONE_SECONDS:
            raise StudioError(
                "run.lost", "the run was killed", file=take.root, fix="Start it again: it continues where it stopped."
            )
        time.sleep(_LOOK)


def _end(event: RunFinished) -> None:
    if event.outcome == "cancelled":
        raise Cancelled
    if event.outcome == "failed":
        raise StudioError(event.code or "run.failed", event.message)
