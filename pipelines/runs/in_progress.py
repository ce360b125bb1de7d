"""What a run in progress is doing, from the take's log."""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass, replace

from pipelines.events import Event, Progress, RunStarted, StageStarted, parse_event
from pipelines.takes.take import Take
from studio.errors import StudioError


@dataclass(frozen=True)
class Running:
    """A run in progress.

    Attributes:
        pid: of its process.
        command: as recorded in the lock, for example "v3studio run".
        host: name of its machine; None for this one.
        stage: the stage that is running; None before the first, and for commands without stages.
        reason: why the stage runs, for example "bake.quality changed from 22 to 30".
        progress: the last progress event of the stage; None if there is none yet.
    """

    pid: int | None
    command: str
    host: str | None = None
    stage: str | None = None
    reason: str = ""
    progress: Progress | None = None


def running(take: Take) -> Running | None:
    """The run that holds the take's lock; None if there is none."""
    holder = take.running()
    if holder is None:
        return None
    pid = holder.get("pid")
    host = holder.get("host")
    elsewhere = str(host) if host not in (None, socket.gethostname()) else None
    found = Running(pid if isinstance(pid, int) else None, str(holder.get("command", "v3studio")), elsewhere)
    begun = started = progress = None
    with contextlib.suppress(OSError), take.log.open(encoding="utf-8", errors="replace") as log:
        for line in log:  # the log of a long run has megabytes, of which few lines matter
            if f'"{RunStarted.kind}"' in line:
                begun = line
            elif f'"{StageStarted.kind}"' in line:
                started, progress = line, None
            elif f'"{Progress.kind}"' in line:
                progress = line
    run, stage, last = (_parsed(line) for line in (begun, started, progress))
    # commands other than runs do not write a log: it is then of an earlier run
    if not isinstance(run, RunStarted) or run.pid != found.pid or not isinstance(stage, StageStarted):
        return found
    return replace(found, stage=stage.stage, reason=stage.reason, progress=last if isinstance(last, Progress) else None)


def _parsed(line: str | None) -> Event | None:
    """None for no line, and for one that is still being written."""
    try:
        return None if line is None else parse_event(line)
    except StudioError:
        return None
