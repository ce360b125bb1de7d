"""Output and actions of scripts/system_packages.sh if packages are missing. All programs that it calls are replaced."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.scripts.conftest import write_program


@pytest.fixture
def bare(programs: Path) -> Path:
    """The programs of a system that has none of the libraries, and whose user has neither root nor sudo."""
    write_program(programs / "python3", f'exec "{sys.executable}" "$@"')
    write_program(programs / "ldconfig", "exit 0")
    write_program(programs / "id", "echo 1000")
    (programs / "sudo").unlink(missing_ok=True)
    write_program(programs / "apt-get", "echo unexpected; exit 1")
    return programs


def look(clone: Path, programs: Path) -> subprocess.CompletedProcess[str]:
    script = clone / "scripts" / "system_packages.sh"
    return subprocess.run(["bash", script], env={"PATH": str(programs)}, capture_output=True, text=True)


def test_a_user_without_root_gets_one_command_to_paste(clone: Path, bare: Path) -> None:
    answer = look(clone, bare)
    assert answer.returncode == 1
    command = answer.stderr.splitlines()[1].strip()
    assert command.startswith("su -c 'apt-get update && apt-get install -y --no-install-recommends ")
    assert {"libegl1", "libgl1", "libvulkan1"} <= set(command.rstrip("'").split())


def test_with_sudo_where_there_is_one(clone: Path, bare: Path) -> None:
    write_program(bare / "sudo", "exit 1")  # it asks for a password
    command = look(clone, bare).stderr.splitlines()[1].strip()
    assert command.startswith("sudo apt-get update && sudo apt-get install -y --no-install-recommends ")


def test_root_installs(clone: Path, bare: Path, tmp_path: Path) -> None:
    write_program(bare / "id", "echo 0")
    write_program(bare / "apt-get", f'echo "$@" >>"{tmp_path}/calls"')
    answer = look(clone, bare)
    assert answer.returncode == 0, answer.stderr
    update, install = (tmp_path / "calls").read_text().splitlines()
    assert update.endswith(" update")
    assert " install -y --no-install-recommends " in install
    assert install.split().count("libegl1") == 1


@pytest.mark.parametrize(
    ("messages", "sentence"),
    [
        ("W: Temporary failure resolving 'deb.example.org'\nE: Unable to fetch some archives", "cannot be reached"),
        ("E: Unable to locate package libegl1", "E: Unable to locate package libegl1"),
    ],
)
def test_a_failure_of_apt_is_one_sentence(clone: Path, bare: Path, messages: str, sentence: str) -> None:
    write_program(bare / "id", "echo 0")
    write_program(bare / "apt-get", f'printf "%s\\n" "{messages}"\nexit 100')
    answer = look(clone, bare)
    assert answer.returncode == 1
    assert len(answer.stderr.splitlines()) == 1
    assert sentence in answer.stderr
