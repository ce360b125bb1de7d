import errno
import os
import resource
from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.takes.atomic_files import atomic_path, disk_errors, sweep_partial, write_json, write_text
from v3studio.studio.atomic_files import machine_name


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "result.json"
    write_json(path, {"a": 1})
    with pytest.raises(UnicodeEncodeError), atomic_path(path) as half, half.open("w", encoding="ascii") as file:
        file.writelines(["half", "\u00fc"])
    assert path.read_text() == '{\n "a": 1\n}\n'
    assert list(tmp_path.iterdir()) == [path]


def test_nan_never_reaches_a_json_file(tmp_path):
    with pytest.raises(ValueError):
        write_json(tmp_path / "x.json", {"psnr": float("nan")})
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_a_sentence_that_names_the_folder(tmp_path):
    """Writes to /dev/full fail like those to a full disk."""
    with refuses("take.disk_full", file=tmp_path), disk_errors(tmp_path):
        Path("/dev/full").write_text("x")


def test_a_limit_of_file_sizes_is_a_sentence(tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        with refuses("take.file_too_large", file=tmp_path), disk_errors(tmp_path):
            (tmp_path / "large").write_bytes(bytes(200))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE, errno.ETIMEDOUT])
def test_a_disk_that_fails_is_a_sentence(tmp_path, number):
    with refuses("take.disk_failed", file=tmp_path / "x"), disk_errors(tmp_path):
        raise OSError(number, os.strerror(number), str(tmp_path / "x"))


def test_sweep_takes_leftovers_only(tmp_path):
    write_text(tmp_path / "deep" / "kept.txt", "x")
    alive = f".marks.{os.getppid()}-{machine_name()}-00000000.partial.json"
    (tmp_path / "deep" / f".kept.999999999-{machine_name()}-00000000.partial.txt").write_text("half")
    (tmp_path / alive).write_text("another process is writing it")
    (tmp_path / ".group_000.partial").mkdir()
    (tmp_path / ".group_000.partial" / "x.mp4").write_text("half")
    assert sweep_partial(tmp_path) == 2
    left = [path.name for path in sorted(tmp_path.rglob("*"))]
    assert left == [alive, "deep", "kept.txt"]
