"""The status of a take's stages: a table for people, JSON for programs."""

from __future__ import annotations

import json
import socket
from dataclasses import asdict

from pipelines.config import Config
from pipelines.reports.tables import escaped, table_of
from pipelines.reports.terminal import console, duration
from pipelines.runs.in_progress import Running, running
from pipelines.runs.runner import status
from pipelines.takes.take import Take

_COLORS = {
    "running": "cyan",
    "done": "green",
    "partial": "yellow",
    "stale": "yellow",
    "failed": "red",
    "missing": "dim",
}


def print_status(take: Take, config: Config) -> None:
    """Print one row per stage, and the run in progress."""
    screen = console()
    table = table_of("stage", "status", "progress", "time", "reason", left=(0, 1, 4))
    now = running(take)
    for name, state in status(take, config).items():
        if now is not None and name == now.stage:
            table.add_row(name, f"[{_COLORS['running']}]running[/]", *_running(now))
            continue
        units = f"{state.units_done}/{state.units} {state.unit}" if state.units else ""
        took = duration(state.seconds) if state.seconds is not None and state.state == "done" else ""
        table.add_row(name, f"[{_COLORS[state.state]}]{state.state}[/]", units, took, escaped(state.reason))
    screen.print(table)
    if now is not None:
        total = None if now.progress is None else now.progress.total_seconds_left
        left = "" if total is None else f", about {duration(total)} left"
        process = "" if now.pid is None else f"process {now.pid}{f' on {now.host}' if now.host else ''}, "
        screen.print(f"run in progress: {process}{now.command}{left}", markup=False)


def _running(now: Running) -> tuple[str, str, str]:
    """Progress, time left, and what the stage that is running is doing."""
    progress = now.progress
    if progress is None:
        return "", "", escaped(now.reason)
    left = "" if progress.seconds_left is None else f"{duration(progress.seconds_left)} left"
    return f"{progress.fraction:.0%}", left, escaped(progress.label or now.reason)


def status_json(take: Take, config: Config) -> str:
    """The same as JSON. `running` says which stage runs; its state in `stages` is "running"."""
    stages = {name: asdict(state) for name, state in status(take, config).items()}
    now = running(take)
    if now is None:
        return json.dumps({"take": str(take.root), "running": None, "stages": stages}, indent=1)
    found: dict[str, object] = {
        "pid": now.pid,
        "host": now.host or socket.gethostname(),
        "command": now.command,
        "stage": now.stage,
        "reason": now.reason,
    }
    if now.progress is not None:
        found |= {
            "fraction": now.progress.fraction,
            "seconds_left": now.progress.seconds_left,
            "total_seconds_left": now.progress.total_seconds_left,
            "label": now.progress.label,
        }
    if now.stage in stages:
        stages[now.stage] |= {"state": "running", "reason": now.reason}
    return json.dumps({"take": str(take.root), "running": found, "stages": stages}, indent=1)
