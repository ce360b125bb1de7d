"""Work in a child process: progress arrives, it can be stopped, and crashes are reported."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.errors import refuses
from v3studio.studio.calibration.sfm.child import run_reporting
from v3studio.studio.errors import Cancelled


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that runs code as the work of a child."""

    def run(code: str, on_line: Callable[..., None] = lambda *line: None, *arguments: str) -> None:
        (tmp_path / "some_work.py").write_text(code)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        run_reporting("some_work", list(arguments), on_line)

    return run


def test_lines_arrive_and_noise_does_not(work: Any) -> None:
    lines: list[tuple[str, int, int]] = []
    code = 'print(\'{"step": "a", "done": 1, "total": 2}\\nnoise\\n[1]\')'
    work(code, lambda step, done, total: lines.append((step, done, total)))
    assert [line for line in lines if line[0]] == [("a", 1, 2)]


def test_errors_and_crashes_of_native_code_are_reported(work: Any) -> None:
    error = {"code": "camera.focal_length", "problem": "no", "value": -1.0, "fields": {"camera": "cam1"}}
    with refuses("camera.focal_length", value=-1.0, camera="cam1"):
        work(f"print({json.dumps({'error': error})!r}); raise SystemExit(1)")
    with refuses("calibration.worker_died", exit_code=-11, stderr="last words"):
        work('import os, sys, signal; print("last words", file=sys.stderr, flush=True)\nos.kill(os.getpid(), 11)')


def test_stopped_at_once_though_the_child_prints_nothing(work: Any, tmp_path: Path) -> None:
    code = "import os, pathlib, sys, time\npathlib.Path(sys.argv[1]).write_text(str(os.getpid()))\ntime.sleep(1e6)"
    pid_file = tmp_path / "pid"

    def stop(*line: object) -> None:
        if pid_file.exists() and pid_file.read_text():
            raise Cancelled

    with pytest.raises(Cancelled):
        work(code, stop, str(pid_file))
    assert not psutil.pid_exists(int(pid_file.read_text()))


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_worker_does_not_outlive_its_parent(tmp_path: Path) -> None:
    """The real worker ends when its standard input closes."""
    (tmp_path / "job.json").write_text('{"names": [], "intrinsics": [], "intrinsics_of": []}')
    child = subprocess.Popen(
        [sys.executable, "-c", "import v3studio.studio.calibration.sfm.worker as w, sys, time\n"
         "w.run = lambda *given: (print('running', flush=True), time.sleep(1e6))\nw.main()",
         str(tmp_path / "job.json")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    child.stdout.readline()
    child.stdin.close()
    child.stdout.close()
    assert child.wait() == 3
