"""The faults of `make attack`."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


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
