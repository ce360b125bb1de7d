"""Runs that go on without the terminal that started them."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence

from pipelines.config import Config
from pipelines.events import RunStarted
from pipelines.events.log_follower import LogFollower
from pipelines.runs.launch import launch
from pipelines.takes.atomic_files import disk_errors
from pipelines.takes.settings_file import save_config
from pipelines.takes.take import Take
from studio.errors import StudioError

_ERRORS = "background.log"


def start_background(take: Take, config: Config, arguments: Sequence[str]) -> str:
    """Start a run that goes on when this process ends.

    With a Ray client address (ray://), it runs on the head node of the cluster, else on this machine.

    Args:
        take: the take.
        config: its settings, which are written to the take.
        arguments: of `v3studio`, without the take: ("run", "--until", "train").

    Returns:
        where it runs, for people: "process 123 on node1".

    Raises:
        StudioError: another run is in progress (`take.locked`), it ended at once, or the cluster cannot be reached.
    """
    holder = take.running()
    if holder is not None:
        raise StudioError(
            "take.locked",
            f"another run is in progress (process {holder.get('pid')}, {holder.get('command')})",
            file=take.root,
            fix="`v3studio attach` shows it.",
            pid=holder.get("pid"),
            command=holder.get("command"),
        )
    with disk_errors(take.root):
        take.private.mkdir(parents=True, exist_ok=True)
        save_config(take.config, config)
    words = [*arguments, "--take", str(take.root), "--json"]
    if config.run.executor == "ray" and config.run.address.startswith("ray://"):
        from pipelines.runs.cluster.detached import start_on_head

        return start_on_head(config.run.address, words, str(take.private / _ERRORS))
    process = launch(words, take.private / _ERRORS)
    log = LogFollower(take.log)
    while process.poll() is None:
        # its first event comes after it has checked the settings and the footage
        if any(isinstance(event, RunStarted) and event.pid == process.pid for event in log.poll()[1]):
            return f"process {process.pid} on {socket.gethostname()}"
        time.sleep(0.1)
    if process.returncode == 0:  # everything was up to date
        return f"process {process.pid}, which has ended: everything is up to date"
    lines = (take.private / _ERRORS).read_text(encoding="utf-8", errors="replace").strip().splitlines()
    raise StudioError(
        "run.failed",
        (lines or ["the run ended at once"])[-1].removeprefix("error: "),
        code_of_process=process.returncode,
    )
