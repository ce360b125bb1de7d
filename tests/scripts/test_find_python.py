"""The Python that scripts/find_python.sh selects, and its errors for an invalid PYTHON."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.scripts.conftest import write_program

THIS_PYTHON = f'exec "{sys.executable}" "$@"'


def find(clone: Path, programs: Path, python: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": str(programs)} | ({} if python is None else {"PYTHON": python})
    script = clone / "scripts" / "find_python.sh"
    return subprocess.run(["bash", script], env=environment, capture_output=True, text=True)


def an_old_python(file: Path) -> Path:
    """This Python, but it reports version 3.9.2."""
    code = "import sys; sys.version_info = (3, 9, 2); exec(sys.argv[1])"
    return write_program(file, f'exec "{sys.executable}" -c \'{code}\' "$2"')


def test_an_older_python3_is_passed_over(clone: Path, programs: Path) -> None:
    an_old_python(programs / "python3")
    newer = write_program(programs / "python3.12", THIS_PYTHON)
    answer = find(clone, programs)
    assert (answer.returncode, answer.stdout.strip()) == (0, str(newer))


def test_python_decides_where_it_is_set(clone: Path, programs: Path) -> None:
    write_program(programs / "python3", THIS_PYTHON)
    mine = write_program(clone / "my python", THIS_PYTHON)
    answer = find(clone, programs, str(mine))
    assert (answer.returncode, answer.stdout.strip()) == (0, str(mine))


@pytest.mark.parametrize(
    ("python", "reason"),
    [("no-such-python", "is not a program"), ("false", "does not run as Python"), ("old", "is Python 3.9.2;")],
)
def test_a_wrong_python_is_refused_by_name(clone: Path, programs: Path, python: str, reason: str) -> None:
    write_program(programs / "python3", THIS_PYTHON)
    an_old_python(programs / "old")
    answer = find(clone, programs, python)
    assert answer.returncode == 1
    assert answer.stdout == ""
    assert f"PYTHON is '{python}'" in answer.stderr
    assert reason in answer.stderr
    assert len(answer.stderr.splitlines()) == 1


def test_none_at_all_is_said(clone: Path, programs: Path) -> None:
    answer = find(clone, programs)
    assert answer.returncode == 1
    assert "found none" in answer.stderr
