"""Work in a child process: progress arrives, it can be stopped, and crashes are reported."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from studio.calibration.sfm.child import WorkerProgress, run_reporting
from studio.errors import Cancelled
from tests.support.errors import refuses


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that writes code to a module and returns the name of the module."""

    def make(code: str) -> str:
        (tmp_path / "some_work.py").write_text(code)
        monkeypatch.syspath_prepend(str(tmp_path))
        return "some_work"

    return make


def alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_lines_arrive_and_noise_does_not(module: Any) -> None:
    lines: list[WorkerProgress | None] = []
    work = module('print(\'{"step": "a", "done": 1, "total": 2}\\nnoise\\n[1]\\n{"finished": true}\')')
    run_reporting(work, [], lines.append, what="The work")
    assert [line for line in lines if line] == [WorkerProgress("a", 1, 2)]


def test_errors_are_reported(module: Any) -> None:
    work = module('print(\'{"error": "ValueError: no"}\'); raise SystemExit(1)')
    with refuses("calibration.worker_failed", value="ValueError: no"):
        run_reporting(work, [], lambda line: None, what="The work")


def test_crashes_are_reported(module: Any) -> None:
    """A crash in native code only ends the child."""
    work = module('import os, sys, signal; print("last words", file=sys.stderr, flush=True)\nos.kill(os.getpid(), 11)')
    with refuses("calibration.worker_died", exit_code=-11, stderr="last words"):
        run_reporting(work, [], lambda line: None, what="The work")


def test_stopped_at_once_though_the_child_prints_nothing(module: Any, tmp_path: Path) -> None:
    work = module(
        "import os, pathlib, sys, time\npathlib.Path(sys.argv[1]).write_text(str(os.getpid()))\ntime.sleep(1e6)"
    )
    pid_file = tmp_path / "pid"

    def stop(line: WorkerProgress | None) -> None:
        if pid_file.exists() and pid_file.read_text():
            raise Cancelled

    with pytest.raises(Cancelled):
        run_reporting(work, [str(pid_file)], stop, what="The work")
    assert not alive(int(pid_file.read_text()))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_worker_does_not_outlive_its_parent(tmp_path: Path) -> None:
    """The real worker ends when its standard input closes."""
    (tmp_path / "job.json").write_text('{"names": [], "intrinsics": [], "intrinsics_of": []}')
    child = subprocess.Popen(
        [sys.executable, "-c", "import studio.calibration.sfm.worker as w, sys, time\n"
         "w.Worker.run = lambda self: (print('running', flush=True), time.sleep(1e6))\nw.main()",
         str(tmp_path / "job.json")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )  # fmt: skip
    child.stdout.readline()
    child.stdin.close()
    child.stdout.close()
    assert child.wait() == 3
