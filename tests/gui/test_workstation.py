"""The whole workflow in the window: from a folder of footage to a wipe, and a run that outlives the window."""

import contextlib
import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.gui.conftest import SIZE

STAGES = ("capture", "calibrate", "initialize", "train", "bake", "review")


def done(state: dict[str, Any]) -> bool:
    return all(state["stages"][stage][0] == "done" for stage in STAGES)


def test_from_footage_to_a_wipe_and_a_run_that_outlives_the_window(
    open_window: Callable, footage_project: Path, tmp_path: Path
) -> None:
    window = open_window()
    window.wait_for("an empty window", lambda s: "New take" in s["message"] or "new take" in s["message"])
    window.menu("File", "new", until=("the dialog", lambda s: s["dialog"] == "new take"))
    window.click("dialog footage")
    window.enter_text("dialog footage", str(footage_project / "cupture"))
    window.click("dialog create", until=("a refusal", lambda s: "dialog refused" in s["widgets"]))
    window.retype("dialog footage", str(footage_project / "capture"))
    window.key("Return", until=("no refusal of a valid folder", lambda s: "dialog refused" not in s["widgets"]))
    window.click("dialog settings")
    window.enter_text("dialog settings", str(footage_project / "ball.yaml"))
    window.click("dialog take")
    window.enter_text("dialog take", str(tmp_path / "take"))
    window.key("Return")
    cameras = ["training", "training", "training", "training", "held out", "training"]
    window.wait_for("the cameras", lambda s: [line.split(": ")[1] for line in s["lines"]] == cameras)
    for use in ("held out", "not used", "training"):
        window.click("dialog sheet", 0.05, 0.1)
        window.wait_for(f"cam0 {use}", lambda s, use=use: s["lines"][0] == f"cam0: {use}")
    window.drag("dialog sheet", (0.05, 0.9), (0.95, 0.9))
    window.wait_for("the frames", lambda s: s["texts"]["dialog frames"] == "0 to 4")
    window.click("dialog create")
    state = window.wait_for("the footage", lambda s: s["stages"]["capture"][0] == "done" and s["stage"] == "capture")
    assert {state["stages"][stage][1] for stage in STAGES[1:]} == {"not run"}
    assert "frames: 0:5\n" in (tmp_path / "take" / "config.yaml").read_text()
    window.wait_for("thumbnails", lambda s: s["settled"])

    # a setting that is refused, and one that is accepted; letters typed into a field are not shortcuts
    window.stage("bake")
    window.retype("setting bake.quality", "77w")
    state = window.key("Return", until=("a refusal", lambda s: "bake.quality" in s["error"]))
    assert state["compare"] == "single"
    window.retype("setting bake.quality", "24")
    window.key("Return", until=("no refusal", lambda s: s["error"] == ""))
    assert "quality: 24" in (tmp_path / "take" / "config.yaml").read_text()

    window.click("all")
    window.saw("a run", lambda s: s["busy"])
    window.stage("train")
    window.wait_for("all done", lambda s: done(s) and not s["busy"], 600)
    window.stage("bake")

    # the title said what the list of stages did, which is drawn with it
    titles = {
        s["title"].removesuffix(" - take - V3 Studio") for s in window.states() if s["busy"] and "%" in s["title"]
    }
    rows = [(name, row) for s in window.states() for name, row in s["stages"].items() if row[0] == "running"]
    assert titles
    assert titles <= {f"{row[1].split(',')[0]} {name.capitalize()}" for name, row in rows}

    # figures of an earlier bake say so
    def earlier(state: dict[str, Any]) -> set[bool]:
        return {"earlier bake" in name for name in state["plots"] if "PSNR" in name}

    assert earlier(window.wait_for("figures", earlier)) == {False}
    window.retype("setting bake.quality", "26")
    window.key("Return", until=("a stale bake", lambda s: s["stages"]["bake"][0] == "stale"))
    window.wait_for("them", lambda s: earlier(s) == {True})
    window.click("run")
    window.saw("a run", lambda s: s["busy"])
    state = window.wait_for("another bake", lambda s: s["stages"]["bake"][0] == "done" and not s["busy"], 600)
    assert state["stages"]["review"][0] == "stale"
    window.wait_for("them", lambda s: earlier(s) == {True})

    window.key("3")  # to the review
    window.wait_for("the decoded stream", lambda s: s["stage"] == "review" and s["what"] == "decoded")
    window.key("Home")
    window.key("w", until=("a reason, or a wipe", lambda s: s["compare"] == "wipe" and s["settled"]))
    before = window.key("c", until=("a camera", lambda s: s["camera"] == "cam4" and s["settled"] and s["shown"] == 0))
    window.drag("viewport", (before["wipe"], 0.6), (0.3, 0.6))
    moved = window.wait_for("a moved line", lambda s: abs(s["wipe"] - 0.3) < 0.05 and s["settled"])
    assert moved["camera"] == "cam4", "dragging the line does not turn the view"
    window.key("d", until=("the difference", lambda s: s["compare"] == "difference" and s["settled"]))

    # a mark with a note
    window.key("m", until=("the question", lambda s: s["dialog"] == "mark"))
    window.click("dialog line")
    window.enter_text("dialog line", "here it is worst")
    window.click("dialog save", until=("the mark", lambda s: s["marks"] == {"0": "here it is worst"}))
    marks = json.loads((tmp_path / "take" / "marks.json").read_text())
    (mark,) = marks["marks"]
    assert (mark["frame"], mark["note"], mark["view"]["camera"]) == (0, "here it is worst", "cam4")
    full = window.key("f", until=("fullscreen", lambda s: s["fullscreen"] and s["widgets"]["viewport"][2] > 1000))
    assert full["widgets"]["viewport"][3] > 700
    window.key("Escape")
    window.wait_for("the panels again", lambda s: not s["fullscreen"] and s["widgets"]["viewport"][2] < 800)
    assert window.process.poll() is None, "Escape does not close the window"
    _check_frames(window, *map(int, SIZE.split("x")))
    window.key("question", until=("the shortcuts", lambda s: s["dialog"] == "message"))
    window.key("Escape", until=("no dialog", lambda s: not s["dialog"]))

    # a run goes on without the window, and a small window finds it again
    config = tmp_path / "take" / "config.yaml"
    config.write_text(config.read_text().replace("keyframe_iterations: 25", "keyframe_iterations: 200000"))
    window.wait_for("a stale training", lambda s: s["stages"]["train"][0] not in ("done", "missing"))
    window.stage("train")
    window.click("run")
    window.wait_for("training", lambda s: s["stages"]["train"][0] == "running" and "%" in s["stages"]["train"][1])
    window.menu("File", "quit", until=("the question", lambda s: s["dialog"] == "ask"))
    window.click("dialog leave")
    assert window.process.wait(60) == 0
    assert "top-level" not in window.stderr.read_text(), "Open3D draws more than 20 widgets of a window wrongly"
    lock = json.loads((tmp_path / "take" / ".v3studio" / "lock").read_text())
    try:
        os.kill(lock["pid"], 0)  # it is alive
        small = open_window(str(tmp_path / "take"), "--size", "820x640")
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
    small.key("3")
    state = small.wait_for("an image", lambda s: s["stage"] == "review" and s["shown"] is not None and s["settled"])
    assert not state["figures"]
    _check_frames(small, 820, 640)
    for key in ("footage", "trained", "decoded", "side by side", "wipe", "difference", "reset view"):
        assert key in state["widgets"], key
    small.key("i", until=("the right panel", lambda s: s["figures"] and "inspector" in s["widgets"] and s["settled"]))
    _check_frames(small, 820, 640)
    small.menu("File", "new")
    state = small.wait_for("the dialog", lambda s: s["dialog"] == "new take" and s["widgets"]["dialog create"][3] > 0)
    assert sum(state["widgets"]["dialog create"][1::2]) < 0.9 * 640, "it does not scroll"
    small.key("Escape", until=("no dialog", lambda s: not s["dialog"]))
    assert small.close() == 0, small.stderr.read_text()[-2000:]


def _check_frames(window: Any, width: int, height: int) -> None:
    """No two widgets of the layout overlap, and all are inside the window."""
    window.drawn()  # what a state tells between two layouts is on no screen
    shown = window.states()[-1]["widgets"]
    frames = {name: np.array(frame) for name, frame in shown.items() if not name.startswith(("dialog", "hint"))}
    frames = {name: frame for name, frame in frames.items() if not name.startswith("setting") and frame[2] > 0}
    assert len(frames) > 15
    for one, a in frames.items():
        assert a[0] >= 0
        assert a[0] + a[2] <= width, one
        assert a[1] + a[3] <= height, one
        assert min(a[2], a[3]) >= 16, f"{one} is too small to be used: {a}"
        for other, b in frames.items():
            if one < other:
                across = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
                down = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
                assert across <= 0 or down <= 0, f"{one} {a} lies over {other} {b}"
