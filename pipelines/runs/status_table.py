"""The status of a take's stages: a table for people, JSON for programs."""

from __future__ import annotations

import json
import socket
from dataclasses import asdict

from pipelines.config import Config
from pipelines.reports.tables import escaped, table_of
from pipelines.reports.terminal import console, duration
from pipelines.runs.runner import status
from pipelines.takes.take import Take

_COLORS = {"done": "green", "partial": "yellow", "stale": "yellow", "failed": "red", "missing": "dim"}


def print_status(take: Take, config: Config) -> None:
    """Print one row per stage, and the run in progress."""
    screen = console()
    table = table_of("stage", "status", "progress", "time", "reason", left=(0, 1, 4))
    for name, state in status(take, config).items():
        units = f"{state.units_done}/{state.units} {state.unit}" if state.units else ""
        took = duration(state.seconds) if state.seconds is not None and state.state == "done" else ""
        table.add_row(name, f"[{_COLORS[state.state]}]{state.state}[/]", units, took, escaped(state.reason))
    screen.print(table)
    holder = take.running()
    if holder is not None:
        where = f" on {holder['host']}" if holder.get("host") not in (None, socket.gethostname()) else ""
        screen.print(f"run in progress: process {holder.get('pid')}{where}, {holder.get('command')}", markup=False)


def status_json(take: Take, config: Config) -> str:
    """The same as JSON."""
    stages = {name: asdict(state) for name, state in status(take, config).items()}
    return json.dumps({"take": str(take.root), "running": take.running(), "stages": stages}, indent=1)
