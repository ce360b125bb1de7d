"""Temporary files: of killed processes, and in errors."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.studio import atomic_files as module
from v3studio.studio.atomic_files import (
    atomic_path,
    is_being_written,
    leftovers,
    remove_leftovers,
    temporary_path,
    write_json,
)
from v3studio.studio.errors import StudioError


def test_only_what_ended_processes_left_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target, names = tmp_path / "turn.mp4", ("turn.mp4", "turn", "other.mp4")
    ended = subprocess.Popen([sys.executable, "-S", "-c", ""])
    ended.wait()
    with monkeypatch.context() as patch:
        patch.setattr(os, "getpid", lambda: ended.pid)
        gone, *others = (temporary_path(tmp_path / name) for name in names)
        old = temporary_path(target, ".old")
        patch.setattr(os, "getpid", os.getppid)
        alive = temporary_path(target)
    mine = temporary_path(target)
    kept = {alive, mine, tmp_path / ".turn.x.partial.mp4"}
    for path in (gone, *others, *kept):
        path.write_bytes(b"half")
    old.mkdir()
    assert [is_being_written(path) for path in (gone, old, alive, mine)] == [False, False, True, False]
    assert leftovers(tmp_path, target) == [gone]
    assert leftovers(tmp_path, target, ".old") == [old]
    remove_leftovers(tmp_path, target)
    assert set(tmp_path.iterdir()) == {*kept, *others, old}
    remove_leftovers(tmp_path)
    assert set(tmp_path.iterdir()) == {*kept, old}
    remove_leftovers(tmp_path / "nowhere", target)


def test_what_another_machine_writes_is_left_until_it_is_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.parametrize("inside", ["", "frame_0001.spz"])
def test_errors_of_the_block_name_the_final_path(tmp_path: Path, inside: str) -> None:
    with refuses("splat_file.position_range", file=tmp_path / "out" / inside), atomic_path(tmp_path / "out") as path:
        raise StudioError("splat_file.position_range", "too far away", file=path / inside)
    with refuses("footage.missing", file=tmp_path / "other"), atomic_path(tmp_path / "out"):
        raise StudioError("footage.missing", "not found", file=tmp_path / "other")


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_json(path, {"a": 1})
    with pytest.raises(UnicodeEncodeError), atomic_path(path) as half, half.open("w", encoding="ascii") as file:
        file.writelines(["half", "\u00fc"])
    assert path.read_text() == '{\n "a": 1\n}\n'
    assert list(tmp_path.iterdir()) == [path]


def test_nan_never_reaches_a_json_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError):
        write_json(tmp_path / "x.json", {"psnr": float("nan")})
    assert list(tmp_path.iterdir()) == []
