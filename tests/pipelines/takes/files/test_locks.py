"""Everything works on a file system without locks, and it is said once what cannot be promised."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.errors import refuses
from tests.support.events import warnings_in
from tests.support.tiny_capture import run_take
from tests.support.warm_python import lose_locks
from v3studio.pipelines.batch.queue_file import QueueFile
from v3studio.pipelines.takes.authored.edits import change_edits, read_edits
from v3studio.pipelines.takes.authored.marks import Mark, change_mark
from v3studio.pipelines.takes.files.locks import held, holder_of
from v3studio.pipelines.takes.take import Take
from v3studio.studio.edits.edit_list import EditList, Trim
from v3studio.studio.errors import Message, StudioError


@pytest.fixture(autouse=True)
def _no_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    lose_locks(monkeypatch.setattr)


def test_a_take_is_run_edited_marked_and_queued(copied: Path, take: Take) -> None:
    events = run_take(copied, stages=("calibrate", "bake"), force=True)
    assert [warning.code for warning in warnings_in(events, "files.no_locks")] == ["files.no_locks"]
    assert not warnings_in(run_take(copied, stages=("calibrate",)), "files.no_locks"), "it is said once"
    assert take.running() is None
    change_edits(take.edits, EditList(trim=Trim(first=1, last=2)), "trim")
    assert read_edits(take.edits).trim == Trim(first=1, last=2)
    assert list(change_mark(take.marks, 1, Mark(frame=1, note="ear"), None)) == [1]
    queue = QueueFile(copied / "queue.json")
    queue.add(take.root, None, ())
    with queue.running():
        assert queue.is_run()
        assert queue.claim() is not None
    assert not queue.is_run()


def refused(holder: object) -> StudioError:
    return StudioError("take.locked", f"{holder}")


def test_a_process_of_this_machine_still_holds_its_lock(tmp_path: Path) -> None:
    told: list[Message] = []
    path = tmp_path / "lock"
    with held(path, refused, told.append, command="one"):
        holder = holder_of(path)
        assert holder is not None
        assert (holder["pid"], holder["host"], holder["command"]) == (os.getpid(), socket.gethostname(), "one")
        with refuses("take.locked"), held(path, refused):
            pass
    assert [message.code for message in told] == ["files.no_locks"]
    ended = subprocess.Popen([sys.executable, "-S", "-c", ""])
    ended.wait()
    here = {"host": socket.gethostname(), "began": "1"}
    another = {"pid": os.getpid(), **here}  # after a crash and a restart, its number is that of this process
    for gone in (
        {"pid": ended.pid, **here},
        another,
        {"pid": 10**30, **here},
        {"pid": 1, "host": "elsewhere"},
        "damaged",
    ):
        path.write_text(json.dumps(gone))
        assert holder_of(path) is None
        with held(path, refused):
            pass
