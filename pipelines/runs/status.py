"""The status of a take's stages and what a run in progress is doing, as tables for people and JSON for programs."""

import contextlib
import socket
from dataclasses import asdict, dataclass, replace

from v3studio.pipelines.config import Config
from v3studio.pipelines.events import Progress, RunStarted, StageStarted, read_line
from v3studio.pipelines.reports.terminal import console, duration, escaped, table_of
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.takes.results.stage_files import checked_cameras
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import reason_of
from v3studio.studio.json_types import JsonData


@dataclass(frozen=True)
class Running:
    """A run in progress."""

    pid: int | None
    command: str  # as recorded in the lock, for example "v3studio run"
    host: str | None = None  # name of its machine; None for this one
    stage: str | None = None  # the stage that is running; None before the first, and for commands without stages
    reason: str = ""  # why the stage runs, for example "bake.quality changed from 22 to 30"
    progress: Progress | None = None  # the last progress event of the stage; None if there is none yet
    paused: bool = False  # whether its process is suspended, known on this machine only

    @property
    def left(self) -> str:
        """The time left of the run, or "paused"; "" if it is not known."""
        left = None if self.progress is None else self.progress.total_seconds_left
        return "paused" if self.paused else "" if left is None else f"{duration(left)} left"


def is_paused(pid: int) -> bool:
    """Whether a process is suspended, by the window or by Ctrl-Z in a terminal."""
    import psutil

    try:
        return bool(psutil.Process(pid).status() == psutil.STATUS_STOPPED)
    except psutil.Error:
        return False


def running(take: Take) -> Running | None:
    """The run that holds the take's lock; None if there is none."""
    holder = take.running()
    if holder is None:
        return None
    pid = holder.get("pid")
    host = holder.get("host")
    elsewhere = str(host) if host not in (None, socket.gethostname()) else None
    now = Running(pid if isinstance(pid, int) else None, str(holder.get("command", "v3studio")), elsewhere)
    now = replace(now, paused=elsewhere is None and now.pid is not None and is_paused(now.pid))
    begun = started = progress = ""
    with contextlib.suppress(OSError), take.log.open(encoding="utf-8", errors="replace") as log:
        for line in log:  # the log of a long run has megabytes, of which few lines matter
            if f'"{RunStarted.kind}"' in line:
                begun = line
            elif f'"{StageStarted.kind}"' in line:
                started, progress = line, ""
            elif f'"{Progress.kind}"' in line:
                progress = line
    run, stage, last = (read_line(line)[0] for line in (begun, started, progress))  # one may be incomplete
    # commands other than runs do not write a log: it is then of an earlier run
    if not isinstance(run, RunStarted) or run.pid != now.pid or not isinstance(stage, StageStarted):
        return now
    return replace(now, stage=stage.stage, reason=stage.reason, progress=last if isinstance(last, Progress) else None)


def progress(take: Take) -> tuple[str, str, float | None]:
    """The progress of a run: words, such as "train 43%, 12 min 05 s left" or "train 43%, paused", or "starting";
    the stage, "" before the first; and how much of the stage is done, 0 to 1, or None if it has not reported yet."""
    try:
        now = running(take)
    except OSError as error:  # the list of takes shows the others
        return f"cannot be read ({reason_of(error)})", "", None
    if now is None or now.stage is None:
        return "paused" if now is not None and now.paused else "starting", "", None
    fraction = None if now.progress is None else now.progress.fraction
    words = now.stage if fraction is None else f"{now.stage} {fraction:.0%}"
    return ", ".join(filter(None, (words, now.left))), now.stage, fraction


_COLORS = {
    "running": "cyan",
    "done": "green",
    "partial": "yellow",
    "stale": "yellow",
    "failed": "red",
    "missing": "dim",
}


def print_status(take: Take, config: Config) -> None:
    """Print one row per stage, whether the cameras are right, and the run in progress."""
    screen = console()
    table = table_of("stage", "status", "progress", "time", "reason", left=(0, 1, 4))
    now = running(take)
    last = ""
    for name, state in status(take, config).items():
        if now is not None and name == now.stage:
            table.add_row(name, f"[{_COLORS['running']}]running[/]", *_running(now))
            continue
        units = f"{state.units_done}/{state.units} {state.unit}" if state.units else ""
        took = duration(state.seconds) if state.seconds is not None and state.state == "done" else ""
        reason = "the same" if state.reason and state.reason == last else escaped(state.reason)
        table.add_row(name, f"[{_COLORS[state.state]}]{state.state}[/]", units, took, reason)
        last = state.reason
    screen.print(table)
    for sentence in checked_cameras(take).sentences:
        screen.print(sentence, markup=False)
    if now is not None:
        left = f", {now.left}" if now.left else ""
        process = "" if now.pid is None else f"process {now.pid}{f' on {now.host}' if now.host else ''}, "
        screen.print(f"run in progress: {process}{now.command}{left}", markup=False)


def _running(now: Running) -> tuple[str, str, str]:
    """Progress, time left, and what the stage that is running is doing."""
    progress = now.progress
    if progress is None:
        return "", "", escaped(now.reason)
    left = "" if progress.seconds_left is None or now.paused else f"{duration(progress.seconds_left)} left"
    return f"{progress.fraction:.0%}", left, escaped(progress.label or now.reason)


def status_values(take: Take, config: Config) -> dict[str, JsonData]:
    """The status for programs. `running` says which stage runs; its state in `stages` is "running"."""
    stages = {name: asdict(state) for name, state in status(take, config).items()}
    now = running(take)
    if now is None:
        return {"take": str(take.root), "running": None, "stages": stages}
    about: dict[str, JsonData] = {
        name: getattr(now, name) for name in ("pid", "host", "command", "stage", "reason", "paused")
    }
    about["host"] = now.host or socket.gethostname()
    if now.progress is not None:
        names = ("fraction", "seconds_left", "total_seconds_left", "label")
        about |= {name: getattr(now.progress, name) for name in names}
    if now.stage in stages:
        stages[now.stage] |= {"state": "running", "reason": now.reason}
    return {"take": str(take.root), "running": about, "stages": stages}
