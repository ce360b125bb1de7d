"""The GPU check runs all its parts on the CPU, and says which failed."""

import json
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks import gpu_check as script
from tests.support.warm_python import warm_python

pytestmark = pytest.mark.long


def test_dry_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def run(command: list[str], cwd: Path, **_: Any) -> subprocess.CompletedProcess[str]:
        return warm_python().run(command[1:], cwd=cwd, text=True)

    monkeypatch.setattr(script, "subprocess", SimpleNamespace(**{**vars(subprocess), "run": run}))
    assert script.main(["--dry-run", "--out", str(tmp_path / "gpu.json")]) == 0, capsys.readouterr().out
    report = json.loads((tmp_path / "gpu.json").read_text())
    parts = report["parts"]
    names = ["kernels", "tests", "training kernels", "rasterizer", "keyframe", "frame 2", "frame 0", "joint training"]
    assert set(parts) == {*names, "group"}
    assert report["dry_run"] is True
    assert [parts[name]["steps"] for name in names[4:]] == [9, 8, 8, 6]
    assert parts["tests"]["tests"] >= 10
    assert parts["joint training"]["psnr"] > parts["group"]["psnr"] > 12
    assert parts["rasterizer"]["cases"][0]["both_ms"] > 0
    kernels = parts["training kernels"]["kernels"]
    assert [one["kernel"] for one in kernels] == ["image loss", "coded loss"]
    assert all(0 < one["error"] < 1e-4 and 0 < one["definition_error"] < 1e-4 for one in kernels)


def test_a_wrong_training_kernel_fails_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "photometric_loss", lambda *images: 1.001 * script.photometric_loss_torch(*images))
    found = script.Check(True).training_kernels()
    assert found["error"] == "wrong: image loss"
    assert found["kernels"][0]["error"] == pytest.approx(1e-3, rel=0.1)


def test_training_ends_when_its_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    check = script.Check(True)
    monkeypatch.setattr(check, "limit", lambda seconds: 0.01)
    assert not check.part(check.group)
    assert "time is up" in check.report["parts"]["group"]["error"]
