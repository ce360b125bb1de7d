import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.takes.take import TAKE_FORMAT, Take
from v3studio.studio.atomic_files import machine_name


def test_what_is_no_take_is_not_taken_over(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"x")
    with refuses("take.not_empty", file=tmp_path):
        Take.create(tmp_path)
    with refuses("take.not_a_take", file=tmp_path, lost=False):
        Take.open(tmp_path)
    (tmp_path / "manifest.json").write_bytes(b"{}")
    with refuses("take.is_stream", file=tmp_path):
        Take.open(tmp_path)
    with refuses("take.is_file", file=tmp_path / "holiday.jpg"):
        Take.create(tmp_path / "holiday.jpg")
    (tmp_path / "take.json").write_text("{")
    with refuses("take.damaged", file=tmp_path / "take.json"):
        Take.open(tmp_path)


@pytest.mark.parametrize(
    ("written", "found"),
    [('{"format": 999, "created_by": "v3studio 9.0"}', 999), ("{}", None), ("[]", None), ('{"format": "1"}', "1")],
)
def test_a_take_of_another_version_is_refused(tmp_path: Path, written: Any, found: Any) -> None:
    (tmp_path / "take.json").write_text(written)
    for act in (Take.open, Take.create):
        with refuses("take.unknown_format", file=tmp_path / "take.json", value=found, expected=TAKE_FORMAT):
            act(tmp_path)


HOLD = """
import sys, time
from pathlib import Path
from v3studio.pipelines.takes.take import Take
with Take(Path(sys.argv[1])).locked("v3studio run"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_run_is_told_who_holds_the_take_and_a_kill_frees_it(tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(take.root)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout.readline() == "held\n"
        began = Path(f"/proc/{holder.pid}/stat").read_text().rpartition(")")[2].split()[19]  # starttime, see proc(5)
        about = {"pid": holder.pid, "command": "v3studio run", "host": socket.gethostname(), "began": began}
        assert take.running() == about
        with refuses("take.locked", file=take.root, pid=holder.pid, command="v3studio run"), take.locked("bake"):
            pass
    finally:
        os.kill(holder.pid, signal.SIGKILL)
        holder.communicate()
    assert take.running() is None
    with take.locked("v3studio bake"):
        assert take.running() is not None


def test_a_take_that_lost_its_take_json_is_taken_up_again(tmp_path: Path) -> None:
    root = tmp_path / "take"
    Take.create(root)
    (root / "config.yaml").write_text("train: {}\n")
    (root / "train").mkdir()
    kept = root / "train" / "frame"
    kept.write_bytes(b"work")
    (root / "take.json").unlink()
    with refuses("take.not_a_take", file=root, lost=True):
        Take.open(root)
    assert Take.create(root) == Take.open(root)
    assert kept.read_bytes() == b"work"


def test_a_run_killed_as_it_created_the_take_is_begun_again(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-S", "-c", ""])
    process.wait()
    left = tmp_path / f".take.{process.pid}-{machine_name()}-00000000.partial.json"
    left.write_text("{")
    take = Take.create(tmp_path)
    assert Take.open(tmp_path) == take
    with take.locked("run"):
        assert not left.exists()


def test_what_a_power_cut_left_empty_is_made_again(tmp_path: Path) -> None:
    """Names can be on the disk before the bytes. Marks are a person's work: they are never deleted."""
    take = Take.create(tmp_path)
    group = take.train_group(0)
    group.mkdir(parents=True)
    for path in (group / "group.json", take.trained_frame(0, 1), tmp_path / "marks.json", take.private / "any.lock"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    with take.locked("run"):
        empty = [path.name for path in tmp_path.rglob("*") if path.is_file() and path.stat().st_size == 0]
    assert sorted(empty) == ["any.lock", "marks.json"]
