"""Fixtures for the scripts' tests: copies of the scripts in a folder with spaces and letters beyond ASCII."""

import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder with nothing but our scripts."""
    folder = tmp_path / "my clone é 三"
    shutil.copytree(ROOT / "scripts", folder / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder to use as PATH: links to this system's programs, to be replaced or removed one by one."""
    folder = tmp_path / "programs"
    folder.mkdir()
    for source in ("/usr/local/bin", "/usr/bin", "/bin", "/usr/sbin", "/sbin"):
        for program in os.scandir(source) if Path(source).is_dir() else ():
            if not (folder / program.name).is_symlink():
                (folder / program.name).symlink_to(program.path)
    for python in folder.glob("python3*"):
        python.unlink()
    return folder
