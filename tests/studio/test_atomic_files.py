"""Temporary files: of killed processes, and in errors."""

import os
import subprocess
import sys
import time

import pytest

from studio import atomic_files as module
from studio.atomic_files import PARTIAL, atomic_path, is_being_written, leftovers, remove_leftovers, temporary_path
from studio.errors import StudioError
from tests.support.errors import refuses


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


def test_what_another_machine_writes_is_left_until_it_is_old(tmp_path, monkeypatch):
    target = tmp_path / "turn"
    monkeypatch.setattr(module, "machine_name", lambda: "0123abcd")
    file, folder = temporary_path(tmp_path / "turn.mp4"), temporary_path(target)
    monkeypatch.undo()
    file.write_bytes(b"half")
    (folder / "videos").mkdir(parents=True)
    (folder / "videos" / "a.mp4").write_bytes(b"half")
    hours_ago = time.time() - 2 * 3600
    for path in (folder / "videos", folder):
        os.utime(path, (hours_ago, hours_ago))
    assert is_being_written(file)
    assert is_being_written(folder), "a file in it is new"
    assert leftovers(tmp_path) == []
    for path in (file, folder / "videos" / "a.mp4"):
        os.utime(path, (hours_ago, hours_ago))
    assert not is_being_written(file)
    assert leftovers(tmp_path) == sorted([file, folder])
    assert leftovers(tmp_path, target) == [folder]


def test_names_of_this_version_tell_whether_their_process_runs(tmp_path, monkeypatch):
    """`what` is told apart, as are processes."""
    dead = dead_pid()
    monkeypatch.setattr(os, "getpid", lambda: dead)
    new, old = temporary_path(tmp_path / "site"), temporary_path(tmp_path / "site", ".old")
    monkeypatch.setattr(os, "getpid", os.getppid)
    alive = temporary_path(tmp_path / "site")
    monkeypatch.undo()
    for path in (new, old, alive):
        path.mkdir()
    assert leftovers(tmp_path, tmp_path / "site") == [new]
    assert leftovers(tmp_path, tmp_path / "site", ".old") == [old]
    assert [is_being_written(path) for path in (new, old, alive)] == [False, False, True]


@pytest.mark.parametrize("inside", ["", "frame_0001.spz"])
def test_errors_of_the_block_name_the_final_path(tmp_path, inside):
    with refuses("splat_file.position_range", file=tmp_path / "out" / inside), atomic_path(tmp_path / "out") as path:
        raise StudioError("splat_file.position_range", "too far away", file=path / inside)
    with refuses("footage.missing", file=tmp_path / "other"), atomic_path(tmp_path / "out"):
        raise StudioError("footage.missing", "not found", file=tmp_path / "other")
