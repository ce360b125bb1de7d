"""Fixtures: small baked streams."""

import shutil
from pathlib import Path

import pytest

from tests.support.shared import made_once
from tests.support.streams import bake_numbered


@pytest.fixture(scope="session")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two streams to copy."""

    def make(folder: Path) -> None:
        bake_numbered(folder / "stream", (5, 4, 1, 6), 50, distinct=True)
        bake_numbered(folder / "long", (14,) * 6, 50, distinct=True)

    return made_once(tmp_path_factory, "playback", make)


@pytest.fixture
def stream(baked: Path, tmp_path: Path) -> Path:
    """Groups of 5, 4, 1 and 6 frames, see `bake_numbered`."""
    return Path(shutil.copytree(baked / "stream", tmp_path / "stream"))


@pytest.fixture
def long_stream(baked: Path, tmp_path: Path) -> Path:
    """Six groups of 14 frames."""
    return Path(shutil.copytree(baked / "long", tmp_path / "long"))
