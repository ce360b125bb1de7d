"""Working copies of takes in an S3 store."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

from pipelines.takes.edits import change_edits
from pipelines.takes.marks import Mark, change_mark
from pipelines.takes.stored_take import StoredTake, stored_take
from studio.edits.edit_list import EditList, Trim
from studio.errors import StudioError
from studio.storage import store
from tests.support.object_store import Faults, ObjectStore

TAKE = "s3://studio/takes/first"


@pytest.fixture
def machine(object_store: ObjectStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The take on a machine with its own cache."""
    monkeypatch.setattr(store, "FIRST_PAUSE", 0.01)

    def on(name: str) -> StoredTake:
        monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / name))
        return StoredTake(TAKE)

    return on


def put(take: StoredTake, **files: str) -> None:
    for name, text in files.items():
        path = take.folder / FILES[name]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


FILES = {
    "about": "take.json",
    "frame0": "train/group_000/frame_000000.safetensors",
    "frame1": "train/group_001/frame_000001.safetensors",
    "group1": "train/group_001/group.json",
    "record": ".v3studio/stages/train.json",
    "lock": ".v3studio/lock",
}


def test_machines_exchange_what_their_groups_need(machine, object_store: ObjectStore, tmp_path):
    object_store.faults = Faults(failing=0.1, truncated=0.1)
    a, b = machine("a"), machine("b")
    assert not a.pull()
    put(a, about="{}", frame0="zero", lock="a")
    assert a.push() == 2
    assert b.pull(group=1)
    assert not (b.folder / FILES["frame0"]).exists(), "nothing of other groups"
    put(b, frame1="one", group1="{}")
    assert b.push() == 2
    assert a.pull()
    assert (a.folder / FILES["frame1"]).read_text() == "one"
    assert a.push() == b.push() == 0
    assert sorted(object_store.contents("takes/first")) == sorted(
        FILES[name] for name in ("about", "frame0", "frame1", "group1")
    )
    again = stored_take(a.folder)
    assert again is not None
    assert again.address == TAKE
    assert stored_take(tmp_path) is None
    # a stage that runs again deletes its record and replaces what it made
    put(a, record="{}")
    a.push()
    b.pull()
    (a.folder / FILES["record"]).unlink()
    put(a, frame0="again")
    a.push()
    b.pull()
    assert not (b.folder / FILES["record"]).exists()
    assert (b.folder / FILES["frame0"]).read_text() == "again"
    assert (b.folder / FILES["frame1"]).read_text() == "one"


def test_what_a_killed_process_did_not_send_is_sent_by_the_next_one(machine, object_store: ObjectStore):
    a = machine("a")
    put(a, about="{}")
    a.push()
    put(a, frame0="not sent")
    again = machine("a")
    again.pull()
    assert (again.folder / FILES["frame0"]).read_text() == "not sent"
    assert again.push() == 1


def test_what_another_machine_finished_replaces_what_was_not_sent(machine):
    a, b = machine("a"), machine("b")
    put(a, about="{}", frame0="first")
    a.push()
    b.pull()
    put(a, frame0="of a")
    put(b, frame0="of b, finished")
    b.push()
    a.pull()
    assert (a.folder / FILES["frame0"]).read_text() == "of b, finished"


def test_records_come_after_what_they_tell_of(machine, object_store: ObjectStore):
    a = machine("a")
    put(a, about="{}", frame0="x" * 500, group1="{}", record="{}")
    object_store.faults = Faults(capacity=400)
    with pytest.raises(StudioError) as caught:
        a.push()
    assert caught.value.code == "storage.full"
    assert object_store.contents("takes/first") == {}
    object_store.faults = Faults()
    assert a.push() == 4


def test_a_kept_bake_is_told_of_last_and_forgotten_first(machine, object_store: ObjectStore, monkeypatch):
    a = machine("a")
    files = {"bakes/fine/bake.json": "{}", "bakes/fine/evaluation.json": "{}", "bakes/fine/stream/manifest.json": "{}"}
    for name, text in files.items():
        (a.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (a.folder / name).write_text(text)
    done: list[str] = []
    for what in ("write", "delete"):
        action = getattr(a.store, what)
        monkeypatch.setattr(
            a.store, what, lambda name, *data, action=action: (done.append(name), action(name, *data))[1]
        )
    a.push()
    assert done.pop() == "bakes/fine/bake.json"
    shutil.rmtree(a.folder / "bakes")
    done.clear()
    a.push()
    assert done[0] == "bakes/fine/bake.json"
    assert object_store.contents("takes/first") == {}


def test_locks_of_a_machine_stay_on_it(machine, object_store: ObjectStore):
    a = machine("a")
    change_edits(a.folder / "edits.json", EditList(trim=Trim(first=0, last=3)), "trim")
    change_mark(a.folder / "marks.json", 3, Mark(frame=3, note="good"), None)
    assert a.push() == 2
    assert sorted(object_store.contents("takes/first")) == ["edits.json", "marks.json"]


def test_results_are_sent_while_a_stage_works_and_when_it_fails(machine, object_store: ObjectStore, monkeypatch):
    monkeypatch.setattr("pipelines.takes.stored_take.PUSH_SECONDS", 0.02)
    a = machine("a")

    def fail() -> None:
        put(a, about="{}")
        while "take.json" not in object_store.contents("takes/first"):
            time.sleep(0.02)
        put(a, frame0="last")
        raise RuntimeError

    with pytest.raises(RuntimeError), a.pushed():
        fail()
    assert FILES["frame0"] in object_store.contents("takes/first")
