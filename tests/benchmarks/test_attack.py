"""The attack in short: its parts that need no take, with few attempts. `make attack` runs all of it."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.warm_python import warm_python

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
LEAST = {"servers": 7}


def test_promises_are_kept(tmp_path: Path) -> None:
    command = ("benchmarks/attack", "--parts", ",".join(LEAST), "--share", 0.003, "--folder", tmp_path)
    ended = warm_python().run(command, cwd=ROOT, text=True, timeout=600)
    assert ended.returncode == 0, ended.stdout[-6000:] + ended.stderr[-3000:]
    for part, least in LEAST.items():
        row = next(line for line in ended.stdout.splitlines() if line.startswith(f"| {part} |"))
        assert int(row.split("|")[2].replace(",", "")) >= least
        assert "kept" in row


@pytest.mark.parametrize("kind", ["kill", "full"])
def test_a_fault_comes_with_the_write_that_it_is_for(tmp_path: Path, kind: str) -> None:
    """Otherwise the attack on takes would find all promises kept."""
    folder = tmp_path / "take"
    folder.mkdir()
    script = f"""
import faults
from pathlib import Path
folder = Path({str(folder)!r})
faults.Faults({kind!r}, 2, folder)
(folder / "a").write_text("x")
Path({str(tmp_path / "elsewhere")!r}).write_text("x")
(folder / "b").write_text("x")
"""
    place = ROOT / "benchmarks" / "attack"
    ended = subprocess.run([sys.executable, "-c", script], cwd=place, capture_output=True, text=True)
    assert [path.name for path in folder.iterdir()] == ["a"]
    if kind == "kill":
        assert ended.returncode == -signal.SIGKILL
    else:
        assert "OSError: [Errno 28]" in ended.stderr
