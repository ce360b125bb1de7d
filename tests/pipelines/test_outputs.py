import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.pipelines.outputs import replacing
from v3studio.pipelines.takes.files.leftovers import sweep_partial
from v3studio.studio.errors import Cancelled


def test_an_output_is_replaced_only_when_asked(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.write_text("old")
    with refuses("output.exists", file=out), replacing(out, False, Path.is_file):
        out.write_text("new")
    assert out.read_text() == "old"
    with replacing(out, True, Path.is_file):
        assert not out.exists()
        out.write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert out.read_text() == "new"


def test_a_failure_restores_what_was_there(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "file").write_text("old")
    with pytest.raises(Cancelled), replacing(out, True, Path.is_dir):
        half_written(out)
    assert (out / "file").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("written", [False, True])
def test_what_a_killed_process_set_aside_is_kept_until_there_is_a_new_one(tmp_path: Path, written: bool) -> None:
    out = tmp_path / "out.txt"
    out.write_text("old")
    program = """
import os, signal, sys
from pathlib import Path
from v3studio.pipelines.outputs import replacing
out = Path(sys.argv[1])
with replacing(out, True, Path.is_file):
    if sys.argv[2] == "True":
        out.write_text("new")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", program, str(out), str(written)], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert len(list(tmp_path.iterdir())) == 1 + written
    sweep_partial(tmp_path)
    with refuses("output.exists", file=out), replacing(out, False, Path.is_file):
        pass
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("out.txt", "new" if written else "old")]


def test_other_things_are_never_deleted(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").touch()
    (tmp_path / "link").symlink_to(tmp_path / "photos")
    for name in ("photos", "link"):
        for overwrite in (False, True):
            with refuses("output.not_ours"), replacing(tmp_path / name, overwrite, Path.is_file):
                pass
        assert (tmp_path / name).exists()


def half_written(out: Path) -> None:
    out.mkdir()
    raise Cancelled
