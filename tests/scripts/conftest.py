"""The scripts as modules (they are not a package, since they run before anything is installed), and copies of them."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"v3studio_script_{name}", SCRIPTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def self_test() -> ModuleType:
    return load("self_test")


@pytest.fixture(scope="session")
def fresh_test() -> ModuleType:
    return load("fresh_test")


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
