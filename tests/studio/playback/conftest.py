"""Fixtures: a small baked stream, a source that can block, and a manual clock."""

import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from studio.stream import FolderSource, StreamReader
from tests.support.shared import made_once
from tests.support.streams import bake_numbered
from tests.support.waiting import HandClock, wait_until

FPS = 50.0


def own_files(folder: Path) -> dict[str, int]:
    """Group by path, of files that belong to a single group."""
    owners: dict[str, set[int]] = {}
    with StreamReader.open(folder) as reader:
        for group in reader.groups:
            for file in group.files:
                owners.setdefault(file.path, set()).add(group.index)
    return {path: next(iter(groups)) for path, groups in owners.items() if len(groups) == 1}


class GatedSource(FolderSource):
    """A folder source that records its reads and can block them."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.gate = threading.Event()
        self.gate.set()
        self.reads: list[str] = []
        self.finished: list[str] = []
        self._own = own_files(root)

    def read(self, path: str, limit: int) -> bytes:
        assert self.gate.wait(20)
        self.reads.append(path)
        data = super().read(path, limit)
        self.finished.append(path)
        return data

    def whole(self, group: int) -> bool:
        """Whether all files of a group have been read."""
        with StreamReader.open(Path(self.name)) as reader:
            files = [file.path for file in reader.groups[group].files]
        own = max(self.finished.index(path) for path, owner in self._own.items() if owner == group)
        return files[-1] in self.finished[own:]

    def groups_read(self) -> list[int]:
        """Groups in the order of the first read of a file that only they have."""
        return list(dict.fromkeys(self._own[path] for path in self.reads if path in self._own))


@pytest.fixture(scope="session")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two streams to copy."""

    def make(folder: Path) -> None:
        bake_numbered(folder / "stream", (5, 4, 1, 6), FPS, distinct=True)
        bake_numbered(folder / "long", (14,) * 6, FPS, distinct=True)

    return made_once(tmp_path_factory, "playback", make)


@pytest.fixture
def stream(baked: Path, tmp_path: Path) -> Path:
    """Groups of 5, 4, 1 and 6 frames, see `bake_numbered`."""
    return Path(shutil.copytree(baked / "stream", tmp_path / "stream"))


@pytest.fixture
def long_stream(baked: Path, tmp_path: Path) -> Path:
    """Six groups of 14 frames."""
    return Path(shutil.copytree(baked / "long", tmp_path / "long"))


@pytest.fixture
def gate() -> type[GatedSource]:
    """See `GatedSource`."""
    return GatedSource


@pytest.fixture
def gated(stream: Path) -> GatedSource:
    """`stream` as a `GatedSource`."""
    return GatedSource(stream)


class FrameClock(HandClock):
    """A clock that only advances by frames of the stream."""

    def forward(self, frames: float) -> None:
        """Advance by a number of frames."""
        self.time += frames / FPS


@pytest.fixture
def clock() -> FrameClock:
    """See `FrameClock`."""
    return FrameClock()


@pytest.fixture
def until() -> Callable[..., None]:
    """`until(condition)`: wait until other threads make it true, on a busy machine too."""

    def wait(condition: Callable[[], bool], what: str = "condition") -> None:
        wait_until(what, condition, 120.0)

    return wait
