"""The run of a take in an S3 store, as other machines see it."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from pipelines.events.log_follower import LogFollower
from pipelines.takes import stored_run
from pipelines.takes.cancel_request import cancelled_on_request
from pipelines.takes.stored_run import StoredRun
from pipelines.takes.stored_take import StoredTake
from pipelines.takes.take import Take
from studio.storage import store
from tests.support.errors import refuses
from tests.support.object_store import BUCKET, ObjectStore
from tests.support.waiting import wait_until

TAKE = "s3://studio/takes/first"


@pytest.fixture
def machine(object_store: ObjectStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The run of the take as a machine with its own cache sees it, and the machine's working copy."""
    monkeypatch.setattr(store, "FIRST_PAUSE", 0.01)
    monkeypatch.setattr(stored_run, "LOOK_SECONDS", 0.02)

    def on(name: str) -> tuple[StoredRun, Take]:
        monkeypatch.setenv("V3STUDIO_CACHE", str(tmp_path / name))
        stored = StoredTake(TAKE)
        return StoredRun(stored), Take.create(stored.folder)

    return on


def lines(first: int, last: int) -> str:
    return "".join(json.dumps({"event": "log", "stage": "", "message": f"line {n}"}) + "\n" for n in range(first, last))


def test_one_machine_runs_a_take_at_a_time(machine, object_store: ObjectStore):
    (a, _), (b, _) = machine("a"), machine("b")
    key = "takes/first/.v3studio/holder.json"
    with a.held("v3studio run"):
        with refuses("take.locked", pid=os.getpid(), command="v3studio run"), b.held("v3studio bake"):
            pass
        client = object_store.client
        held = json.loads(client.get_object(Bucket=BUCKET, Key=key)["Body"].read())
        for change in ({"renewed": time.time() - 1000, "host": "elsewhere"}, {"pid": 2**22 + 1}):
            client.put_object(Bucket=BUCKET, Key=key, Body=json.dumps({**held, **change}))
            b.refuse_other()  # it was killed: no error
    with b.held("v3studio bake"):
        pass


def test_other_machines_see_the_run_and_its_log(machine, monkeypatch):
    monkeypatch.setattr(stored_run, "SEGMENT", 300)
    (a, there), (b, here) = machine("a"), machine("b")
    there.private.mkdir(exist_ok=True)
    there.log.write_text("of an earlier run\n")
    with b.followed():
        assert here.running() is None
        with a.held("v3studio run"):
            wait_until("the run is seen", lambda: here.running() is not None, 60)
            found = here.running()
            assert found is not None
            assert (found["pid"], found["command"]) == (os.getpid(), "v3studio run")
            assert here.lock_holder() is None
            with refuses("take.locked", pid=os.getpid()), here.locked("v3studio bake"):
                pass
            there.log.write_text(lines(0, 3))
            follower = LogFollower(here.log)
            wait_until("its log", lambda: here.log.is_file() and here.log.read_text() == lines(0, 3), 60)
            assert len(follower.poll()[1]) == 3
            with there.log.open("a") as log:
                log.write(lines(3, 40))
            wait_until("more of it", lambda: here.log.read_text() == lines(0, 40), 60)
            anew, events = follower.poll()
            assert (anew, len(events)) == (False, 37), "events come once"
            with there.log.open("a") as log:
                log.write(lines(40, 41))
        wait_until("its end", lambda: here.running() is None, 60)
        assert here.log.read_text() == lines(0, 41), "the last events arrive, too"
        with a.held("v3studio run"):
            there.log.write_text(lines(100, 101))
            wait_until("the log of the next run", lambda: here.log.read_text() == lines(100, 101), 60)


def test_a_run_that_is_not_followed_any_longer_counts_as_running_for_two_minutes(machine):
    (a, _), (b, here) = machine("a"), machine("b")
    with a.held("v3studio run"):
        b.refresh()
    assert here.running() is not None
    holder = json.loads(here.holder.read_text())
    here.holder.write_text(json.dumps({**holder, "renewed": time.time() - 121}))
    assert here.running() is None
    here.holder.write_text("[1]")
    assert here.running() is None


def test_what_others_on_its_machine_look_at_does_not_stop_the_run(machine):
    """They copy its claim into the working copy that they share, for as long as it has not locked the folder."""
    (run, take), (looks, _) = machine("a"), machine("a")
    with run.held("v3studio run"):
        looks.refresh()
        assert take.holder.is_file()
        with take.locked("v3studio run"):
            pass
        claim = json.loads(take.holder.read_text())
        take.holder.write_text(json.dumps({**claim, "token": "of another run"}))
        with refuses("take.locked"), take.locked("v3studio run"):
            pass


def test_a_run_is_cancelled_from_another_machine(machine, object_store: ObjectStore):
    (a, there), (b, _) = machine("a"), machine("b")
    b.request_cancel()  # there is no run
    asked: list[bool] = []
    with a.held("v3studio run"):
        object_store.client.put_object(
            Bucket=BUCKET, Key="takes/first/.v3studio/cancel", Body=b'{"token": "of another run"}'
        )
        with cancelled_on_request(there, lambda: asked.append(True)):
            wait_until(
                "the other request is dropped",
                lambda: ".v3studio/cancel" not in object_store.contents("takes/first"),
                60,
            )
            assert not asked
            b.request_cancel()
            wait_until("the request arrives", lambda: bool(asked), 60)
    assert ".v3studio/cancel" not in object_store.contents("takes/first")
