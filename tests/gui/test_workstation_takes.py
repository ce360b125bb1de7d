"""A job that outlives the window, with real mouse and keyboard events."""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Callable
from pathlib import Path


def test_a_job_outlives_the_window_and_is_found_again(open_window: Callable, take_copy: Path) -> None:
    config = take_copy / "config.yaml"
    config.write_text(config.read_text().replace("keyframe_iterations: 25", "keyframe_iterations: 200000"))
    window = open_window(str(take_copy))
    window.wait_for("a stale training", lambda s: s["stages"]["train"][0] not in ("done", "missing"))
    window.stage("train")
    window.click("run")
    window.wait_for("training", lambda s: s["stages"]["train"][0] == "running" and "%" in s["stages"]["train"][1])
    window.menu("File", "quit")
    window.wait_for("the question", lambda s: s["dialog"] == "ask")
    window.click("dialog leave")
    assert window.process.wait(60) == 0
    lock = json.loads((take_copy / ".v3studio" / "lock").read_text())
    try:
        os.kill(lock["pid"], 0)  # it is alive
        again = open_window(str(take_copy))
        again.wait_for("the job, found again", lambda s: s["busy"] and s["stages"]["train"][0] == "running")
        again.stage("train")
        again.click("pause")
        again.wait_for("a pause", lambda s: s["stages"]["train"][1] == "paused")
        again.click("pause")
        again.wait_for("the run going on", lambda s: "%" in s["stages"]["train"][1])
        again.click("cancel")
        again.wait_for("its end", lambda s: not s["busy"])
        assert again.close() == 0
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(lock["pid"], signal.SIGKILL)
