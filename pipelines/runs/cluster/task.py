"""What runs on a node of the cluster: one stage of one group.

Imports of this module are light, so that a node that cannot run the task can say so.
"""

from __future__ import annotations

import os
import platform
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studio.environment import passive_openmp
from studio.errors import Message, StudioError

_PROGRESS_SECONDS = 0.5
"""Shortest interval between two progress events of a task: hundreds of tasks send them."""

NOT_VISIBLE = "cluster.not_visible"
"""Code of the error of a node that does not see the take or the footage; another node may."""


@dataclass(frozen=True)
class GroupTask:
    """A stage of a group, as it is sent to a node: plain values only.

    Attributes:
        take: the take's folder.
        footage: the footage's folder.
        stage: name of the stage.
        group: number of the group.
        attempt: 1 at first.
        key: `GroupStage.group_key`, as the sender knows it.
        settings: values by dotted name that replace those of the take.
        version: of V3 Studio, and `python` of Python, at the sender.
    """

    take: str
    footage: str
    stage: str
    group: int
    attempt: int
    key: str
    settings: tuple[tuple[str, Any], ...]
    version: str
    python: str


def versions() -> tuple[str, str]:
    """Of V3 Studio and of Python ("3.11")."""
    from pipelines.version import program_version

    return program_version(), ".".join(platform.python_version_tuple()[:2])


def run_task(task: GroupTask, mailbox: Any, node: str) -> Message | None:
    """Do the task.

    Args:
        task: what to do.
        mailbox: actor with a method `put(group, attempt, lines)` that receives events as JSON.
        node: id of this node.

    Returns:
        None, or what went wrong, as plain values.
    """
    passive_openmp()  # before torch is imported
    from pipelines.events import Event, Metrics, Preview, Progress, Warned

    last = 0.0

    def emit(event: Event) -> None:
        nonlocal last
        if not isinstance(event, Metrics | Preview | Progress | Warned):
            return
        if isinstance(event, Progress):
            if time.monotonic() - last < _PROGRESS_SECONDS and event.fraction < 1:
                return
            last = time.monotonic()
        mailbox.put.remote(task.group, task.attempt, event.to_json())

    mailbox.started.remote(task.group, task.attempt, node, os.environ.get("CUDA_VISIBLE_DEVICES", ""))
    try:
        _do(task, emit)
    except StudioError as error:
        return _plain(error.message)
    return None


def _plain(message: Message) -> Message:
    known = {"code", "message", "file", "value", "fix"}
    found = message.to_dict()
    fields = {name: value for name, value in found.items() if name not in known}
    return Message(message.code, message.problem, found.get("file"), found.get("value"), message.fix, fields)


def _do(task: GroupTask, emit: Any) -> None:
    from pipelines.config import load_config
    from pipelines.runs.work import work
    from pipelines.takes.take import Take

    here = versions()
    if here != (task.version, task.python):
        raise StudioError(
            "cluster.version",
            f"{socket.gethostname()} has V3 Studio {here[0]} on Python {here[1]}, but the run was started with "
            f"{task.version} on Python {task.python}",
            fix="Install the same versions on all nodes.",
            node=socket.gethostname(),
        )
    for path, what in ((Path(task.take, "take.json"), "take"), (Path(task.footage), "footage")):
        if not path.exists():
            raise StudioError(
                NOT_VISIBLE,
                f"{socket.gethostname()} cannot see the {what}",
                file=path,
                fix="Mount it on all nodes under the same path.",
                node=socket.gethostname(),
            )
    take = Take.open(Path(task.take))
    config = load_config(take.config, task.settings)
    work(take, config, (task.stage,), task.group, emit, expected=task.key)
