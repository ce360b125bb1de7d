"""Temporary files of killed processes."""

import os
import subprocess
import sys

from studio.atomic_files import PARTIAL, leftovers, remove_leftovers, temporary_path


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
