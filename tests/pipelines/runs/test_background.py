"""Runs that continue without their terminal: started with --detach, shown by status, cancelled from anywhere."""

import pytest

from pipelines.events import Finished, Metrics
from pipelines.runs.launch import Launched
from tests.support.events import events_in, result_of
from tests.support.waiting import wait_until

pytestmark = pytest.mark.long


def test_a_detached_run_is_shown_and_cancelled_and_continues(project, cli, here):
    take = project / "take"
    slow = ("--train.keyframe_iterations", "20000")
    # in a process of its own, since the run is its child
    begun = cli("run", project / "ball.yaml", "--take", take, "--until", "train", "--detach", *slow)
    assert begun.returncode == 0, begun.stderr
    assert "Running in the background (process " in begun.stdout
    assert f"v3studio cancel {take}" in begun.stdout
    assert "run in progress: process" in here("status", take).stdout
    refused = here("run", take, "--detach")
    assert refused.returncode == 1
    assert "another run is in progress" in refused.stderr

    here("cancel", take).ok()
    log = take / ".v3studio" / "events.jsonl"
    # the take is free a moment before the last event is written
    wait_until("its last event", lambda: isinstance(events_in(log.read_text())[-1], Finished))
    assert events_in(log.read_text())[-1].outcome == "cancelled"
    assert "run in progress" not in here("status", take).stdout
    none = here("cancel", take)
    assert none.returncode == 1
    assert "no run is in progress" in none.stderr

    quick = cli("run", take, "--until", "train", "--json", "--train.keyframe_iterations", "25")
    assert quick.returncode == 0, quick.stderr
    assert [event for event in events_in(quick.stdout) if isinstance(event, Metrics) and event.stage == "train"]


def test_with_json_a_detached_run_prints_one_object(project, here, monkeypatch):
    found = Launched(pid=7, host="node1")
    monkeypatch.setattr("pipelines.runs.background.start_background", lambda *_: found)
    done = here("run", project / "ball.yaml", "--take", project / "take", "--detach", "--json").ok()
    assert result_of(done.stdout) == {"take": str(project / "take"), "pid": 7, "host": "node1", "running": True}
