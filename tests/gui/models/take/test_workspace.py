import json
import os
import signal
import sys
from pathlib import Path

import psutil
import pytest

from tests.support.errors import refuses
from tests.support.hostile_streams import executed, plant
from tests.support.looping import heard, wait_in_loop
from tests.support.waiting import wait_until
from tests.support.warm_python import forking, warm_python
from v3studio.gui.drawing.palette import FAIR
from v3studio.gui.models.stage_rows import TITLES
from v3studio.gui.models.take.jobs import Job
from v3studio.gui.models.take.run_state import Level, RunState
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.start.cards import describe
from v3studio.pipelines.events import (
    Event,
    Finished,
    Metrics,
    Progress,
    RunStarted,
    StageFailed,
    StageFinished,
    StageStarted,
)
from v3studio.pipelines.takes.take import Take


def progress(fraction: float, **figures: object) -> Progress:
    return Progress(stage="train", fraction=fraction, seconds_left=90.0, label="frame 1", figures=dict(figures))


def test_a_run_told_by_its_events() -> None:
    run = RunState()
    run.apply(RunStarted(take="t", stages=("train", "bake"), done=("calibrate",), pid=7, version="1"))
    run.apply(StageStarted(stage="train", reason="not run yet"))
    run.apply(progress(0.25, loss=0.5, psnr=20.0, splats=100))
    assert (run.stage, run.stage_words()) == ("train", "25%, 1 min 30 s left")
    run.apply(progress(0.5, loss=0.4, psnr=21.0, splats=120))
    run.apply(progress(0.6, loss=0.9, psnr=15.0, splats=80, group=1))
    assert run.curves["loss"][0].positions == [0.25, 0.5]
    assert run.curves["splats"][0].values == [100.0, 120.0]
    assert run.curves["loss"][1].values == [0.9], "groups that train in parallel have separate curves"
    before = run.results
    run.apply(Metrics(stage="train", values={"splats": 120}, group=0, frame=3))
    run.apply(StageFinished(stage="train", seconds=2.0))
    assert run.results == before + 2
    assert (run.stage, run.finished) == ("", ["train"])
    told = len(run.lines)
    run.apply(Metrics(stage="evaluate", values={"psnr_decoded": 30.0}))
    assert len(run.lines) == told, "said when the stage has finished"
    run.apply(StageFailed(stage="bake", message="The disk is full.", traceback=""))
    run.apply(Finished(outcome="failed", seconds=3.0, message="The disk is full."))
    assert (run.outcome, run.failed) == ("failed", {"bake": "The disk is full."})
    assert [line.level for line in run.lines].count(Level.ERROR) == 2
    assert sum("disk is full" in line.text for line in run.lines) == 1, "reported once"
    following = run.followed()
    assert following.outcome == ""
    assert [line.text for line in following.lines] == [line.text for line in run.lines], "the log continues"
    assert not any(line.notice for line in following.lines), "what they warned of may be fixed"
    assert not following.begun
    assert following.curves["psnr"][0].values == [20.0, 21.0]
    following.apply(progress(0.1, loss=0.7))
    assert following.curves["loss"][0].values == [0.7], "a new training run starts over"
    assert "psnr" not in following.curves


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
        ("import sys; sys.stderr.write('boom\\n'); sys.exit(3)", "status 3: boom"),
        (
            "import sys; sys.stderr.write('error: no GPU\\nWarning: a library, as it is unloaded\\n'); sys.exit(1)",
            "status 1: error: no GPU",
        ),
        ("import sys; sys.exit(1)", "status 1: no error message"),
    ],
)
def test_a_crash_is_a_sentence_with_the_end_of_its_output(tmp_path: Path, code: str, said: str) -> None:
    job = Job(Take.create(tmp_path / "take"), (), program=(sys.executable, "-c", code))
    wait_until("ended", lambda: not job.take_events() and job.status is not None)
    crash = job.crash()
    assert said in crash[0]
    run = RunState(stage="train")
    run.apply(StageStarted(stage="train", reason=""))
    run.crashed(*crash)
    assert run.outcome == "failed"
    assert said in run.failed["train"]


def test_a_job_executes_nothing_of_the_take(take_copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant(take_copy, tmp_path / "told")
    monkeypatch.setenv("PYTHONPATH", os.pathsep)
    job = Job(Take.open(take_copy), ("run", "--until", "initialize"))
    events: list[Event] = []
    wait_until("ended", lambda: bool(events.extend(job.take_events())) or job.status is not None)
    events += job.take_events()
    assert (job.status, executed(tmp_path / "told")) == (0, "")
    assert isinstance(events[-1], Finished)


def states(workspace: Workspace) -> dict[str, str]:
    return {row.key: row.state for row in workspace.rows()}


def test_a_setting_makes_stages_stale_and_a_run_makes_them_done_again(workspace: Workspace, take_copy: Path) -> None:
    workspace.open(Take.open(take_copy))
    wait_in_loop("assessed", lambda: states(workspace) == dict.fromkeys(TITLES, "done"))
    assert workspace.row("capture").words == "6 cameras, 5 frames"
    with refuses("settings.invalid", file=None) as refusal:
        workspace.change_settings({"bake.quality": 99})
    assert "must be" in refusal.value.problem
    workspace.change_settings({"bake.quality": 33})
    wait_in_loop("stale", lambda: states(workspace)["bake"] == "stale")
    assert states(workspace)["train"] == "done"
    assert "'quality' in Bake changed from 22 to 33" in workspace.row("bake").detail
    ended = heard(workspace.run_ended)
    assert workspace.start("review")
    refused = heard(workspace.refused)
    assert not workspace.start("all"), "one run at a time"
    assert "Another run is in progress" in str(refused)
    with refuses("settings.run_active"):
        workspace.change_settings({"bake.quality": 34})
    wait_in_loop("over", lambda: not workspace.busy)
    assert workspace.run.planned == ("bake", "evaluate")
    assert workspace.run.finished == ["bake", "evaluate"]
    wait_in_loop("done again", lambda: states(workspace) == dict.fromkeys(TITLES, "done"))
    assert workspace.run.outcome == "done"
    assert str(ended.pop()[0]).startswith("The run has finished after ")


def test_a_run_in_a_terminal_shows_up_can_be_stopped_and_gone_on_with(
    workspace: Workspace, take_copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("subprocess.Popen", forking(warm_python()))
    workspace.open(Take.open(take_copy))
    command = ("-m", "v3studio.pipelines.cli", "run", "--take", take_copy, "--json")
    slow = ("--train.keyframe_iterations", 100_000, "--run.check_footage", "false")
    with (tmp_path / "output").open("wb") as output:
        terminal = warm_python().popen((*command, *slow), output=output)
    try:
        wait_in_loop("seen to train", lambda: states(workspace)["train"] == "running" and bool(workspace.run.curves))
        assert workspace.job is None
        assert workspace.busy
        workspace.pause()
        assert (workspace.paused, workspace.row("train").words) == (True, "paused")
        process = psutil.Process(terminal.pid)
        wait_until("halted", lambda: process.status() == psutil.STATUS_STOPPED)
        halted, written = process.cpu_times(), take_copy.joinpath(".v3studio", "events.jsonl").stat().st_size
        workspace.open(Take.open(take_copy))  # read what it had written
        assert workspace.paused
        assert process.cpu_times() == halted
        assert take_copy.joinpath(".v3studio", "events.jsonl").stat().st_size == written
        workspace.pause()
        assert not workspace.paused
        steps = workspace.run.changes
        wait_in_loop("going on", lambda: workspace.run.changes > steps)
        workspace.pause()
        workspace.cancel()  # cancelling works on a paused run too
        assert terminal.wait(60) == 130
    finally:
        terminal.kill()
        terminal.wait()
    wait_in_loop("over", lambda: not workspace.busy and workspace.run.outcome == "cancelled")
    workspace.change_settings({"train.keyframe_iterations": 100_001})
    assert workspace.start("train")
    wait_in_loop("training", lambda: workspace.run.stage == "train")
    os.kill(workspace.job.pid, signal.SIGKILL)
    wait_in_loop("crashed", lambda: not workspace.busy)
    assert states(workspace)["train"] == "failed"
    assert "SIGKILL" in workspace.row("train").detail


def test_a_step_that_takes_longer_than_its_estimate_tells_for_how_long() -> None:
    run = RunState()
    run.apply(StageStarted(stage="train", reason=""))
    assert run.stage_words() == "starting"
    run.heard -= 330
    assert "5 min 30 s" in run.stage_words()
    run.apply(Progress(stage="train", fraction=0.99, seconds_left=1.2))
    assert run.stage_words() == "99%, 1.2 s left"
    run.heard -= 190
    assert "left" not in run.stage_words()
    assert "3 min 10 s" in run.stage_words()
    run.apply(Progress(stage="train", fraction=0.99, label="checking image 3 of 20"))
    assert run.stage_words() == "99%, checking image 3 of 20"


def test_stages_that_a_run_elsewhere_will_run_are_not_done(workspace: Workspace, take_copy: Path) -> None:
    take = Take.open(take_copy)
    workspace.open(take)
    wait_in_loop("assessed", lambda: states(workspace) == dict.fromkeys(TITLES, "done"))
    assert "evaluate" in workspace.run.finished, "by the last run"
    with take.locked("v3studio run"):
        take.log.unlink()  # a run begins an empty log, and writes its first line later
        take.log.touch()
        wait_in_loop("the lock", lambda: workspace.busy)
        run = RunStarted(take="take", stages=("train", "bake", "evaluate"), done=(), pid=os.getpid(), version="1")
        take.log.write_text(f"{run.to_json()}\n{StageStarted(stage='train', reason='').to_json()}\n")
        wait_in_loop("training", lambda: states(workspace)["train"] == "running")
        shown = states(workspace)
        assert (shown["train"], shown["bake"], shown["review"]) == ("running", "waiting", "waiting")


def test_warnings_are_there_after_reopening_until_it_runs_without_them(workspace: Workspace, take_copy: Path) -> None:
    take = Take.open(take_copy)
    path = take.record("initialize")
    warning = {"message": "Camera 'cam1': half of the mask is missing.", "code": "hull.mask_mismatch", "value": 0.5}
    other = {"message": "No camera is near.", "code": "coverage.gaps"}
    path.write_text(json.dumps({**json.loads(path.read_text()), "warnings": [other, warning]}))
    workspace.open(take)
    wait_in_loop("assessed", lambda: workspace.checked)
    row = workspace.row("initialize")
    assert (row.state, bool(row.doubts), row.color) == ("done", True, FAIR)
    assert row.detail == warning["message"], "the worst"
    assert row.setting == "capture.mask_sensitivity"
    card = describe(str(take_copy))
    assert (card.words, card.state) == (warning["message"], "stale")
    assert workspace.start("initialize", again=True)
    wait_in_loop("over", lambda: not workspace.busy and workspace.checked)
    left = [warning.code for warning in workspace.assessment.stages["initialize"].warnings]
    assert "hull.mask_mismatch" not in left
