"""A copy of the scripts, and a PATH whose programs can be replaced."""

import os
import shutil
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


def write_program(file: Path, script: str) -> Path:
    """A program in place of what is there."""
    file.unlink(missing_ok=True)
    file.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    file.chmod(0o755)
    return file


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder that contains only our scripts and has spaces and non-ASCII characters in its name."""
    folder = tmp_path / "my clone é 三"
    shutil.copytree(SCRIPTS, folder / "scripts", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder for PATH with links to the programs of this system, which tests replace or remove individually."""
    folder = tmp_path / "programs"
    folder.mkdir()
    for source in ("/usr/local/bin", "/usr/bin", "/bin", "/usr/sbin", "/sbin"):
        for program in os.scandir(source) if Path(source).is_dir() else ():
            if not (folder / program.name).is_symlink():
                (folder / program.name).symlink_to(program.path)
    for python in folder.glob("python3*"):
        python.unlink()
    return folder
