"""The attack in short: its parts that need no take, with few attempts. `make attack` runs all of it."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.warm_python import warm_python

ROOT = Path(__file__).parents[2]
LEAST = {"files": 60, "streams": 40, "servers": 7}


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


def test_files_of_others_are_seen_late(tmp_path: Path) -> None:
    folder = tmp_path / "take"
    folder.mkdir()
    (folder / "a").write_text("old")
    script = f"""
import late_files, os, subprocess
from pathlib import Path
folder = Path({str(folder)!r})
late_files.install(folder, 1000)
subprocess.run("echo new > .a; mv .a a; mkdir c; echo x > b; echo x > c/d", shell=True, cwd=folder, check=True)
(folder / "own").write_text("mine")
seen = [sorted(path.name for path in folder.rglob("*")), sorted(os.listdir(folder)), (folder / "a").read_text()]
print(seen, (folder / "b").exists(), (folder / "own").read_text())
"""
    place = ROOT / "benchmarks" / "attack"
    told = subprocess.run([sys.executable, "-c", script], cwd=place, capture_output=True, text=True, check=True)
    assert told.stdout == "[['a', 'c', 'own'], ['a', 'c', 'own'], 'old'] False mine\n"
    assert (folder / "a").read_text() == "new\n"
