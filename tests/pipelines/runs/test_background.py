from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.events import events_in, frames_in
from tests.support.tiny_capture import v3studio
from tests.support.waiting import wait_until
from v3studio.pipelines.events import Finished
from v3studio.pipelines.runs import background
from v3studio.pipelines.runs.launch import Launched

pytestmark = pytest.mark.long


def test_a_detached_run_is_shown_and_cancelled_and_continues(project: Path, here: Callable[..., Any]) -> None:
    take = project / "take"
    slow = ("--train.keyframe_iterations", "20000")
    # in a process of its own, since the run is its child
    begun = v3studio("run", project / "ball.yaml", "--take", take, "--until", "train", "--detach", *slow).ok()
    assert "Running in the background (process " in begun.stdout
    assert f"v3studio cancel {take}" in begun.stdout
    assert "run in progress: process" in here("status", take).stdout
    here("run", take, "--detach").fails("another run is in progress")

    here("cancel", take).ok()
    log = take / ".v3studio" / "events.jsonl"
    # the take is free a moment before the last event is written
    wait_until("its last event", lambda: isinstance(events_in(log.read_text())[-1], Finished))
    assert events_in(log.read_text())[-1].outcome == "cancelled"
    assert "run in progress" not in here("status", take).stdout
    here("cancel", take).fails("no run is in progress")
    quick = here("run", take, "--until", "train", "--json", "--train.keyframe_iterations", "25").ok()
    assert frames_in(quick.events)


def test_with_json_a_detached_run_prints_one_object(
    project: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    launched = Launched(pid=7, host="node1")
    monkeypatch.setattr("v3studio.pipelines.runs.background.start_background", lambda *_: launched)
    done = here("run", project / "ball.yaml", "--take", project / "take", "--detach", "--json").ok()
    assert done.result == {"take": str(project / "take"), "pid": 7, "host": "node1", "running": True}


REFUSED = {
    "masks that are missing": ("--capture.garbage_masks", "nosuch.yaml"),
    "an earlier stage that is stale": ("--train.group_size", "2"),
    "no GPU": ("--run.device", "cuda:7"),
    "no cluster": ("--run.executor", "ray", "--run.address", "somewhere"),
    "a run in the background": ("--capture.garbage_masks", "nosuch.yaml", "--detach"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_command_that_is_refused_leaves_the_settings_as_they_were(
    name: str, copied: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background, "launch", lambda *_: None)
    monkeypatch.setattr(background, "until_begun", lambda *_: Launched(7, "node1", 1, "error: no such file"))
    take, settings = copied / "take", copied / "ball.yaml"
    before = (take / "config.yaml").read_bytes()
    here("bake", settings, "--take", take, "--bake.quality", "31", *REFUSED[name]).fails()
    assert (take / "config.yaml").read_bytes() == before
