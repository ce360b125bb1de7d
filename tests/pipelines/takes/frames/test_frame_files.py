"""Too little memory and too many open files are not damage, and nobody is told to delete a file."""

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from tests.support.errors import refuses
from v3studio.pipelines.takes.frames.frame_files import (
    FrameMetadata,
    has_key,
    intact,
    read_about,
    read_frame,
    read_tensors,
    write_tensors,
)
from v3studio.pipelines.takes.results.integrity import check_take
from v3studio.pipelines.takes.take import Take


@contextmanager
def no_more_files() -> Iterator[None]:
    """Within, this process cannot open any file."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    descriptor = os.open(os.devnull, os.O_RDONLY)
    resource.setrlimit(resource.RLIMIT_NOFILE, (descriptor, limits[1]))  # the first that is not open yet, or near it
    taken = []
    try:
        try:
            while True:
                taken.append(os.dup(descriptor))
        except OSError:
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
        for number in (descriptor, *taken):
            os.close(number)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = Take.create(tmp_path).trained_frame(0, 0)
    write_tensors(path, {"means": torch.zeros(2, 3)}, FrameMetadata(key="of this"))
    return path


def test_too_many_open_files_are_not_damage(file: Path) -> None:
    with no_more_files():
        with refuses("take.cannot_read", file=file):
            read_frame(file)
        for read in (intact, read_about, lambda path: has_key(path, "of this"), lambda path: read_tensors(path, "")):
            with pytest.raises(OSError) as caught:
                read(file)
            assert caught.value.errno == errno.EMFILE
    assert has_key(file, "of this")


def test_too_little_memory_is_not_damage(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> bytes:
        raise MemoryError

    monkeypatch.setattr(Path, "read_bytes", full)
    for read in (read_frame, intact, lambda path: read_tensors(path, "of this")):
        with pytest.raises(MemoryError):
            read(file)
    with pytest.raises(MemoryError):  # `v3studio check` would list the file, and delete it with --remove
        check_take(Take(tmp_path), ("train",))
