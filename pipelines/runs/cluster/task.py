"""A task on a node of the cluster: one stage of one group.

Imports of this module are light, so that a node that cannot run the task can say so.
"""

import contextlib
import os
import platform
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from v3studio.pipelines.events import Event, GroupStarted, Metrics, Preview, Progress, Warned
from v3studio.studio.errors import Message, StudioError
from v3studio.studio.process import passive_openmp
from v3studio.studio.storage import is_address

_PROGRESS_SECONDS = 0.5  # shortest interval between two progress events of a task: hundreds of tasks write them

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

VISIBLE_SECONDS = 20.0  # how long files that another node wrote may take to appear: network file systems cache folders

_MAY_BECOME_VISIBLE = (NOT_VISIBLE, "stage.dependency", "work.take_changed")
"""Codes of errors before the work that an older state of the take may cause."""

LOOK_AGAIN = 1.0  # seconds between two attempts


@dataclass(frozen=True)
class GroupTask:
    """A stage of a group, as it is sent to a node: plain values only."""

    take: str
    footage: str  # the footage's folder, or its address in object storage
    stage: str
    group: int
    attempt: int
    key: str  # `GroupStageCode.group_key`, as the sender knows it
    settings: tuple[tuple[str, Any], ...]  # values by dotted name that replace those of the take
    versions: tuple[str, str]  # at the sender
    paths: tuple[tuple[str, tuple[str, ...]], ...] = ()  # `run.paths`: a folder and its paths on other machines
    since: int = 0  # `Inputs.since` of the stage

    @property
    def events(self) -> str:
        """Name of the file in `Take.group_events` to which the task writes its events."""
        return f"{self.stage}_{self.group:03d}_{self.attempt}.jsonl"


def versions() -> tuple[str, str]:
    """The versions of V3 Studio and of Python ("3.11")."""
    from v3studio.pipelines.version import program_version

    return program_version(), ".".join(platform.python_version_tuple()[:2])


def run_task(task: GroupTask, node: str) -> Message | None:
    """Do the task; None, or what went wrong, as plain values."""
    passive_openmp()  # before torch is imported
    try:
        _refuse_other_versions(task)
        _do_when_visible(task, node)
    except StudioError as error:
        return _plain(error.message)
    return None


def _plain(message: Message) -> Message:
    known = {"code", "message", "file", "value", "fix"}
    parts = message.to_dict()
    fields = {name: value for name, value in parts.items() if name not in known}
    return Message(message.code, message.problem, parts.get("file"), parts.get("value"), message.fix, fields)


def _refuse_other_versions(task: GroupTask) -> None:
    here = versions()
    if here != task.versions:
        problem = (
            f"{socket.gethostname()} has V3 Studio {here[0]} on Python {here[1]}, but the run was started with "
            f"{task.versions[0]} on Python {task.versions[1]}"
        )
        fix = "Install the same versions on all nodes."
        raise StudioError("cluster.version", problem, fix=fix, node=socket.gethostname())


def _do_when_visible(task: GroupTask, node: str) -> None:
    """Do the task; what another node has just written may not be visible here yet."""
    until = time.monotonic() + VISIBLE_SECONDS
    while True:
        try:
            do_task(task, node)
            return
        except StudioError as error:
            if error.message.code not in _MAY_BECOME_VISIBLE or time.monotonic() > until:
                raise
        time.sleep(LOOK_AGAIN)


def do_task(task: GroupTask, node: str) -> None:
    from v3studio.pipelines.config import load_config
    from v3studio.pipelines.events.event_log import EventLog
    from v3studio.pipelines.runs.cluster.work import work
    from v3studio.pipelines.takes.take import Take

    take = Take.open(_here(Path(task.take, "take.json"), "take", task).parent)
    with contextlib.suppress(OSError):
        take.group_events.mkdir(exist_ok=True)
    log = EventLog(take.group_events / task.events, _PROGRESS_SECONDS)
    gpu = os.environ.get("CUDA_VISIBLE_DEVICES", "")
    log(GroupStarted(stage=task.stage, group=task.group, node=node, gpu=gpu, attempt=task.attempt))

    def emit(event: Event) -> None:
        if isinstance(event, Metrics | Preview | Progress | Warned):
            log(event)

    if not is_address(task.footage):
        _here(Path(task.footage), "footage", task)
    config = load_config(take.config, task.settings)
    try:
        work(take, config, task.stage, task.group, task.key, emit, task.since)
    except StudioError as error:
        if error.message.code not in _FOOTAGE_CODES:
            raise
        raise _not_visible("footage", error.message.file or task.footage, f" ({error.message.problem})") from None


def _here(path: Path, what: str, task: GroupTask) -> Path:
    """The path of the take or the footage on this node."""
    from v3studio.pipelines.takes.files.path_here import is_there, places_to_look

    places = places_to_look(path, dict(task.paths))
    there = next((place for place in places if is_there(place)), None)
    if there is None:
        raise _not_visible(what, path, f", nor under {', '.join(map(str, places[1:]))}" if places[1:] else "")
    return there


def _not_visible(what: str, file: str | os.PathLike[str], how: str) -> StudioError:
    problem = f"{socket.gethostname()} cannot see the {what} there{how}"
    fix = "Mount it on all nodes under the same path, or set run.paths."
    return StudioError(NOT_VISIBLE, problem, file=file, fix=fix, node=socket.gethostname())
