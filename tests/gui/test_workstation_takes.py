"""Jobs that outlive the window, and broken takes, with real mouse and keyboard events."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

from tests.support.streams import group_files


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


def break_settings(take: Path) -> None:
    (take / "config.yaml").write_text("train: [")


def break_manifest(take: Path) -> None:
    (take / "stream" / "manifest.json").write_text("{")


def break_plane(take: Path) -> None:
    victim = group_files(take / "stream", 0)[0]
    victim.write_bytes(victim.read_bytes()[:-20])


def break_rig(take: Path) -> None:
    (take / "calibrate" / "rig.json").write_text("[]")


def break_frame(take: Path) -> None:
    (take / "train" / "group_000" / "frame_000000.safetensors").write_bytes(b"x")


def break_evaluation(take: Path) -> None:
    (take / "evaluation.json").write_text("null")


def break_format(take: Path) -> None:
    (take / "take.json").write_text('{"format": 99}')


BROKEN: tuple[tuple[Callable[[Path], None], str], ...] = (
    (break_format, "format 99"),
    (break_settings, "config.yaml"),
    (break_manifest, "manifest.json"),
    (break_plane, "left out: files/"),
    (break_rig, "rig.json"),
    (break_frame, ""),
    (break_evaluation, ""),
)


def test_broken_takes_are_sentences(open_window: Callable, finished_project: Path, tmp_path: Path) -> None:
    """One window opens one broken take after another, as from the recent list, and never crashes."""
    for number, (damage, _) in enumerate(BROKEN):
        take = Path(shutil.copytree(finished_project / "take", tmp_path / f"take{number}"))
        damage(take)
    names = [str(tmp_path / f"take{number}") for number in range(len(BROKEN))]
    settings = tmp_path / "config" / "v3studio"
    settings.mkdir(parents=True)
    (settings / "window.json").write_text(json.dumps({"recent": names}))
    window = open_window()
    window.wait_for("a window", lambda s: s["dialog"] == "")
    for number, (damage, said) in enumerate(BROKEN):
        window.menu("File", "recent")
        state = window.wait_for("the list", lambda s: s["dialog"] == "recent")
        shown = json.loads((settings / "window.json").read_text())["recent"]
        assert len(state["widgets"]) > len(shown)
        window.click(f"dialog choice{shown.index(names[number])}")
        state = window.wait_for(damage.__name__, lambda s: s["dialog"] == "" and s["opening"] == "")
        if said.startswith("left out: "):  # the other group still plays
            said = said.removeprefix("left out: ")
            window.wait_for(
                f"{damage.__name__}: {said}", lambda s, said=said: any(said in one for one in s["left_out"])
            )
            window.key("space")
            window.wait_for("playing", lambda s: s["playing"] and s["shown"] is not None)
            window.key("space")
        elif said:
            window.wait_for(f"{damage.__name__}: {said}", lambda s, said=said: said in s["message"] + s["notice"])
        else:
            window.wait_for(damage.__name__, lambda s: s["shown"] is not None and s["settled"])
        if window.states()[-1]["start"]:  # nothing has been opened yet
            continue
        for stage in ("train", "bake", "calibrate", "review"):
            window.stage(stage)
        assert window.process.poll() is None
    assert window.close() == 0, window.stderr.read_text()[-2000:]
    assert "top-level" not in window.stderr.read_text(), "Open3D draws more than 20 widgets of a window wrongly"
