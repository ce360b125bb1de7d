"""Runs in the window: from a folder of footage to a stream, and one that outlives the window."""

import contextlib
import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.gui.conftest import RunningWindow, State, assert_apart

STAGES = ("capture", "calibrate", "initialize", "set", "train", "bake", "review")

SMALL = (820, 640)
"""Size of a small window, in which the right panel is hidden at first."""


def done(state: State) -> bool:
    return all(state["stages"][stage][0] == "done" for stage in STAGES)


def test_a_take_is_made_of_footage_and_run(
    open_window: Callable[..., RunningWindow], footage_project: Path, tmp_path: Path
) -> None:
    window = open_window()
    window.wait_for("an empty window", lambda s: "new take" in s["message"].lower())
    window.menu("File", "new", until=("the dialog", lambda s: s["dialog"] == "new take"))
    window.click("dialog footage")
    window.enter_text("dialog footage", str(footage_project / "cupture"))
    window.click("dialog create", until=("a refusal", lambda s: "dialog refused" in s["widgets"]))
    window.retype("dialog footage", str(footage_project / "capture"))
    window.key("Return", until=("no refusal of a valid folder", lambda s: "dialog refused" not in s["widgets"]))
    for field, path in (("settings", footage_project / "ball.yaml"), ("take", tmp_path / "take")):
        window.click(f"dialog {field}")
        window.enter_text(f"dialog {field}", str(path))
    window.key("Return")
    cameras = ["training", "training", "training", "training", "held out", "training"]
    window.wait_for("the cameras", lambda s: [line.split(": ")[1] for line in s["lines"]] == cameras)
    for use in ("held out", "not used", "training"):
        chosen = (f"cam0 {use}", lambda s, use=use: s["lines"][0] == f"cam0: {use}")
        window.choose("dialog sheet", "cam0", until=chosen)
    frames = (window.part("dialog sheet", f"frame {frame}") for frame in (0, 4))
    window.drag("dialog sheet", *frames, until=("the frames", lambda s: s["texts"]["dialog frames"] == "0 to 4"))
    window.click("dialog create")
    state = window.wait_for("the footage", lambda s: s["stages"]["capture"][0] == "done" and s["stage"] == "capture")
    assert {state["stages"][stage][1] for stage in STAGES[1:]} == {"not run"}
    assert "frames: 0:5\n" in (tmp_path / "take" / "config.yaml").read_text()
    window.wait_for("thumbnails", lambda s: s["settled"])
    window.click("all")
    window.wait_for("all done", lambda s: done(s) and not s["busy"], 600)
    _assert_titles(window.states())
    assert window.close() == 0, window.stderr.read_text()[-2000:]


def _assert_titles(states: list[State]) -> None:
    """The title said what the list of stages did, which is drawn with it."""
    titles = {s["title"].removesuffix(" - take - V3 Studio") for s in states if s["busy"] and "%" in s["title"]}
    rows = [(name, row) for s in states for name, row in s["stages"].items() if row[0] == "running"]
    assert titles
    assert titles <= {f"{row[1].split(',')[0]} {name.capitalize()}" for name, row in rows}


@pytest.fixture
def training(take_copy: Path) -> Path:
    """A take whose training takes long."""
    config = take_copy / "config.yaml"
    config.write_text(config.read_text().replace("keyframe_iterations: 25", "keyframe_iterations: 200000"))
    return take_copy


def test_a_run_goes_on_without_the_window_and_a_small_one_finds_it(
    open_window: Callable[..., RunningWindow], training: Path
) -> None:
    window = open_window(str(training))
    window.wait_for("a stale training", lambda s: s["stages"]["train"][0] not in ("done", "missing"))
    window.stage("train")
    window.click("run")
    window.wait_for("training", lambda s: s["stages"]["train"][0] == "running" and "%" in s["stages"]["train"][1])
    window.menu("File", "quit", until=("the question", lambda s: s["dialog"] == "ask"))
    window.click("dialog leave")
    assert window.process.wait(60) == 0
    lock = json.loads((training / ".v3studio" / "lock").read_text())
    try:
        os.kill(lock["pid"], 0)  # it is alive
        small = open_window(str(training), "--size", "x".join(map(str, SMALL)))
        small.wait_for("the job, found again", lambda s: s["busy"] and s["stages"]["train"][0] == "running")
        small.stage("train")
        small.click("pause", until=("a pause", lambda s: s["stages"]["train"][1] == "paused"))
        small.menu("File", "report")  # it would evaluate the take first
        small.wait_for("a refusal", lambda s: s["notice"].startswith("Another run is in progress"))
        small.click("pause", until=("the run going on", lambda s: "%" in s["stages"]["train"][1]))
        small.click("cancel", until=("its end, and that of the refusal", lambda s: not s["busy"] and s["notice"] == ""))
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(lock["pid"], signal.SIGKILL)
    _assert_small(small)
    assert small.close() == 0, small.stderr.read_text()[-2000:]


def _assert_small(window: RunningWindow) -> None:
    """Everything can be reached in a small window."""
    window.key("3")
    state = window.wait_for("an image", lambda s: s["stage"] == "review" and s["shown"] is not None and s["settled"])
    assert not state["figures"]
    assert_apart(window, *SMALL)
    assert {"footage", "trained", "decoded", "side by side", "wipe", "difference", "reset view"} <= set(
        state["widgets"]
    )
    window.key("i", until=("the right panel", lambda s: s["figures"] and "inspector" in s["widgets"] and s["settled"]))
    assert_apart(window, *SMALL)
    dialog = ("the dialog", lambda s: s["dialog"] == "new take" and s["widgets"]["dialog create"][3] > 0)
    state = window.menu("File", "new", until=dialog)
    assert sum(state["widgets"]["dialog create"][1::2]) < 0.9 * SMALL[1], "it does not scroll"
