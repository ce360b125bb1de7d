"""Temporary files of killed processes."""

import os
import subprocess
import sys

import pytest

from studio.atomic_files import PARTIAL, exchange, leftovers, remove_leftovers, temporary_path


def dead_pid():
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-S", "-c", ""])
    process.wait()
    return process.pid


def test_only_what_ended_processes_left_is_removed(tmp_path):
    dead, alive, target = dead_pid(), os.getppid(), tmp_path / "turn.mp4"
    kept = {f".turn.{alive}{PARTIAL}.mp4", ".turn.x.partial.mp4"}
    names = {*kept, f".turn.{dead}{PARTIAL}", f".other.{dead}{PARTIAL}.mp4"}
    for name in (*names, f".turn.{dead}{PARTIAL}.mp4"):
        (tmp_path / name).write_bytes(b"half")
    (tmp_path / f".turn.{dead}.old{PARTIAL}.mp4").mkdir()
    mine = temporary_path(target)
    mine.write_bytes(b"half")
    assert leftovers(tmp_path, target, ".old") == [tmp_path / f".turn.{dead}.old{PARTIAL}.mp4"]
    remove_leftovers(tmp_path, target)
    assert {path.name for path in tmp_path.iterdir()} == {*names, mine.name, f".turn.{dead}.old{PARTIAL}.mp4"}
    remove_leftovers(tmp_path)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {*kept, mine.name, f".turn.{dead}.old{PARTIAL}.mp4"}
    remove_leftovers(tmp_path / "nowhere", target)


def test_folders_are_swapped_in_one_step(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    if not exchange(tmp_path / "a", tmp_path / "b"):
        pytest.skip("this file system cannot swap folders")
    assert [path.relative_to(tmp_path).as_posix() for path in sorted(tmp_path.glob("*/*"))] == ["a/b", "b/a"]
    with pytest.raises(FileNotFoundError):
        exchange(tmp_path / "a", tmp_path / "missing")
