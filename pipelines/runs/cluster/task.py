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
from typing import TYPE_CHECKING, Any

from studio.environment import passive_openmp
from studio.errors import Message, StudioError

if TYPE_CHECKING:
    from pipelines.takes.take import Take

_PROGRESS_SECONDS = 0.5
"""Shortest interval between two progress events of a task: hundreds of tasks send them."""

NOT_VISIBLE = "cluster.not_visible"
"""Code of the error of a node that does not see the take or the footage; another node may."""

NODE_CODES = ("storage.missing_package", "storage.no_credentials", "storage.denied", "storage.cache_full")
"""Codes of errors that may be this node's only, too."""

_FOOTAGE_CODES = (
    "footage.folder_missing",
    "footage.folder_unreadable",
    "footage.not_found",
    "footage.no_common_frame",
    "footage.camera_missing",
    "calibration.camera_missing",
)
"""Codes of errors while footage is opened that was complete where the run was started: the folder is there, but what
belongs into it is not mounted."""

VISIBLE_SECONDS = 20.0
"""How long files that another node wrote may take to appear: network file systems cache folders."""

_MAY_BECOME_VISIBLE = (NOT_VISIBLE, "stage.dependency", "work.groups_unknown", "work.take_changed")
"""Codes of errors before the work that an older state of the take may cause."""

_LOOK_AGAIN = 1.0
"""Seconds between two attempts."""


@dataclass(frozen=True)
class GroupTask:
    """A stage of a group, as it is sent to a node: plain values only.

    Attributes:
        take: the take's folder, or its address in object storage.
        footage: the footage's folder, or its address in object storage.
        paths: `run.paths`: a folder and its paths on other machines.
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
    paths: tuple[tuple[str, tuple[str, ...]], ...] = ()


def versions() -> tuple[str, str]:
    """Of V3 Studio and of Python ("3.11")."""
    from pipelines.version import program_version

    return program_version(), ".".join(platform.python_version_tuple()[:2])


def run_task(task: GroupTask, mailbox: Any, node: str) -> Message | None:
    """Do the task.

    Args:
        task: what to do.
        mailbox: actor with methods `started(stage, group, attempt, node, gpu)` and `put(stage, group, attempt, line)`,
            which receives an event as JSON.
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
        mailbox.put.remote(task.stage, task.group, task.attempt, event.to_json())

    mailbox.started.remote(task.stage, task.group, task.attempt, node, os.environ.get("CUDA_VISIBLE_DEVICES", ""))
    try:
        _refuse_other_versions(task)
        _do_when_visible(task, emit)
    except StudioError as error:
        return _plain(error.message)
    return None


def _plain(message: Message) -> Message:
    known = {"code", "message", "file", "value", "fix"}
    found = message.to_dict()
    fields = {name: value for name, value in found.items() if name not in known}
    return Message(message.code, message.problem, found.get("file"), found.get("value"), message.fix, fields)


def _refuse_other_versions(task: GroupTask) -> None:
    here = versions()
    if here != (task.version, task.python):
        raise StudioError(
            "cluster.version",
            f"{socket.gethostname()} has V3 Studio {here[0]} on Python {here[1]}, but the run was started with "
            f"{task.version} on Python {task.python}",
            fix="Install the same versions on all nodes.",
            node=socket.gethostname(),
        )


def _do_when_visible(task: GroupTask, emit: Any) -> None:
    """Do the task; what another node has just written may not be visible here yet."""
    until = time.monotonic() + VISIBLE_SECONDS
    while True:
        try:
            _do(task, emit)
            return
        except StudioError as error:
            if error.message.code not in _MAY_BECOME_VISIBLE or time.monotonic() > until:
                raise
        time.sleep(_LOOK_AGAIN)


def _do(task: GroupTask, emit: Any) -> None:
    from pipelines.takes.stored_take import StoredTake
    from pipelines.takes.take import Take
    from studio.storage import is_address

    if is_address(task.take):
        stored = StoredTake(task.take)
        stored.pull(None if task.stage == "evaluate" else task.group)
        with stored.pushed():
            _work(Take.open(stored.folder), task, emit)
        return
    about = _here(Path(task.take, "take.json"), "take", task)
    if not is_address(task.footage):
        _here(Path(task.footage), "footage", task)
    _work(Take.open(about.parent), task, emit)


def _work(take: Take, task: GroupTask, emit: Any) -> None:
    from pipelines.config import load_config
    from pipelines.runs.work import work

    config = load_config(take.config, task.settings)
    try:
        work(take, config, (task.stage,), task.group, emit, expected=task.key)
    except StudioError as error:
        if error.message.code not in _FOOTAGE_CODES:
            raise
        raise _not_visible("footage", error.message.file or task.footage, f" ({error.message.problem})") from None


def _here(path: Path, what: str, task: GroupTask) -> Path:
    """Where the take or the footage is on this node."""
    from pipelines.takes.path_here import is_there, places_to_look

    places = places_to_look(path, dict(task.paths))
    found = next((place for place in places if is_there(place)), None)
    if found is None:
        raise _not_visible(what, path, f", nor under {', '.join(map(str, places[1:]))}" if places[1:] else "")
    return found


def _not_visible(what: str, file: str | os.PathLike[str], how: str) -> StudioError:
    return StudioError(
        NOT_VISIBLE,
        f"{socket.gethostname()} cannot see the {what} there{how}",
        file=file,
        fix="Mount it on all nodes under the same path, or set run.paths.",
        node=socket.gethostname(),
    )
