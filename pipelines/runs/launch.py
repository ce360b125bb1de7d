"""Starts `v3studio` as a process that outlives the one that starts it."""

import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from v3studio.pipelines.events import RunStarted
from v3studio.pipelines.events.event_log import LogFollower
from v3studio.studio.process import python_command, start

ERRORS = "background.log"  # file in a take's private folder with the standard error of a run without a terminal


@dataclass(frozen=True)
class Launched:
    """A run that was started and has begun, or ended at once with an exit `code` and, if not 0, an `error`."""

    pid: int
    host: str
    code: int | None = None
    error: str = ""


def launch(words: Sequence[str], errors: Path, variables: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
    """Start `v3studio WORDS` in a session of its own; standard error goes to a file."""
    with errors.open("wb") as file:
        return start(
            python_command("v3studio.pipelines.cli", *words),
            variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=file,
            start_new_session=True,
        )


def until_begun(process: subprocess.Popen[bytes], log: Path, errors: Path) -> Launched:
    """Wait until a run has checked settings and footage, after which its first event comes, or has ended."""
    host = socket.gethostname()
    follower = LogFollower(log)
    while process.poll() is None:
        if any(isinstance(event, RunStarted) and event.pid == process.pid for event in follower.poll()[1]):
            return Launched(process.pid, host)
        time.sleep(0.1)
    if process.returncode == 0:
        return Launched(process.pid, host, 0)
    lines = errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return Launched(process.pid, host, process.returncode, (lines or ["the run ended at once"])[-1])
