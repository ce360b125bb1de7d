import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.looping import wait_in_loop
from v3studio.gui.models.take import take_queue
from v3studio.gui.models.take.take_queue import QueueRow, TakeQueue, look
from v3studio.pipelines.batch.queue_file import QueueFile
from v3studio.pipelines.batch.run_queue import errors_of
from v3studio.pipelines.events import Progress, RunStarted, StageStarted
from v3studio.pipelines.events.event_log import EventLog
from v3studio.pipelines.takes.take import Take


def failing(queue: QueueFile) -> subprocess.Popen[bytes]:
    errors_of(queue).write_text("a warning\nerror: the disk is full\n")
    return subprocess.Popen([sys.executable, "-c", "raise SystemExit(1)"])


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TakeQueue:
    monkeypatch.setattr(take_queue, "LOOK_EVERY", 0.0)
    monkeypatch.setattr(take_queue, "start_queue", failing)
    return TakeQueue(QueueFile(tmp_path / "queue.json"))


def test_what_is_refused_is_said(shown: TakeQueue, tmp_path: Path) -> None:
    shown.add(tmp_path)
    assert "not a take" in shown.message
    shown.remove(7)
    assert "no take with number 7" in shown.message
    shown.stop()
    assert "is not running" in shown.message
    shown.start()
    assert shown.running
    wait_in_loop("the end", lambda: not shown.running)
    assert shown.message == "the disk is full"
    (tmp_path / "queue.json").write_text("[")
    wait_in_loop("the error", lambda: shown.view.error != "")
    assert "queue.json" in shown.words


def test_the_progress_of_the_take_that_runs(tmp_path: Path) -> None:
    queue = QueueFile(tmp_path / "queue.json")
    take = Take.create(tmp_path / "walk")
    queue.add(take.root, None, ())
    with queue.running():
        queue.replace(1, state="running")
        assert look(queue).rows == (QueueRow(1, take.root, "running", "starting"),)
        with take.locked("v3studio run"):
            log = EventLog(take.log, 2.0)
            log(RunStarted(take="", stages=("train",), done=(), pid=os.getpid(), version=""))
            log(StageStarted(stage="train", reason="not run yet"))
            log(Progress(stage="train", fraction=0.43, total_seconds_left=725.0))
            view = look(queue)
    assert (view.is_run, view.rows[0].words) == (True, "train 43%, 12 min 05 s left")
    assert look(queue).rows[0].words == "interrupted"
