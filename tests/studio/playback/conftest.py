"""Fixtures: a small baked stream, a source that can block, and a manual clock."""

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from studio.gaussians import Gaussians
from studio.stream import BakeSettings, FolderSource, bake_group, write_manifest

FPS = 50.0


class GatedSource(FolderSource):
    """A folder source that records its reads and can block them."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.gate = threading.Event()
        self.gate.set()
        self.reads: list[str] = []
        self.finished: list[str] = []

    def read(self, path: str, limit: int) -> bytes:
        assert self.gate.wait(20)
        self.reads.append(path)
        data = super().read(path, limit)
        self.finished.append(path)
        return data

    def whole(self, group: str) -> bool:
        """Whether all files of a group have been read."""
        files = {f"{group}/{file.name}" for file in (Path(self.name) / group).iterdir()}
        return files <= set(self.finished)

    def groups_read(self) -> list[str]:
        """Group folders in the order of their first read."""
        return list(dict.fromkeys(path.split("/")[0] for path in self.reads if "/" in path))


def bake_numbered(folder: Path, lengths: tuple[int, ...]) -> Path:
    """A stream at 50 fps with groups of these lengths. Splat 0 of frame i is at x = i, which identifies the frame."""
    settings = BakeSettings(profile="planes", qp=0)
    entries, first = [], 0
    for group, length in enumerate(lengths):
        frames = []
        for index in range(first, first + length):
            means = torch.zeros(40, 3)
            means[:, 0] = index
            quats = torch.tensor([[1.0, 0, 0, 0]]).repeat(40, 1)
            frames.append(Gaussians(means, quats, -3 * torch.ones(40, 3), torch.zeros(40), torch.zeros(40, 1, 3)))
        entries.append(bake_group(frames, folder, group, first, settings))
        first += length
    write_manifest(folder, entries, FPS, settings)
    return folder


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    """Groups of 5, 4, 1 and 6 frames, see `bake_numbered`."""
    return bake_numbered(tmp_path / "stream", (5, 4, 1, 6))


@pytest.fixture
def long_stream(tmp_path: Path) -> Path:
    """Six groups of 14 frames."""
    return bake_numbered(tmp_path / "long", (14,) * 6)


@pytest.fixture
def gate() -> type[GatedSource]:
    """See `GatedSource`."""
    return GatedSource


@pytest.fixture
def gated(stream: Path) -> GatedSource:
    """`stream` as a `GatedSource`."""
    return GatedSource(stream)


class HandClock:
    """A clock that only advances manually."""

    def __init__(self) -> None:
        self.seconds = 100.0

    def __call__(self) -> float:
        return self.seconds

    def forward(self, frames: float) -> None:
        """Advance by a number of frames of the stream."""
        self.seconds += frames / FPS


@pytest.fixture
def clock() -> HandClock:
    """See `HandClock`."""
    return HandClock()


@pytest.fixture
def until() -> Callable[..., None]:
    """`until(condition)`: wait up to 10 s until other threads make it true."""
    import time

    def wait(condition: Callable[[], bool], what: str = "condition") -> None:
        for _ in range(2000):
            if condition():
                return
            time.sleep(0.005)
        raise AssertionError(f"{what} was not met in 10 s")

    return wait
