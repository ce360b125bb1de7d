"""Random access and threads: a frame is the same in whatever order it is read."""

from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from studio.stream import BakeSettings, StreamReader
from tests.support.errors import refuses


def same(a, b) -> bool:
    return all(torch.equal(x, y) for (_, x), (_, y) in zip(a.items(), b.items(), strict=True))


@pytest.fixture
def stream(make_stream):
    return make_stream((4, 1, 5), splats=150, settings=BakeSettings(profile="planes", quality=25))[0]


def test_any_order_gives_the_same_frames(stream):
    with StreamReader.open(stream) as reader:
        in_order = list(reader.iterate())
        assert len(in_order) == 10
        for index in (9, 0, 3, 3, 5, 4, 8, 6, 1):
            assert same(reader.gaussians(index), in_order[index])


def test_iterate_from_the_middle(stream):
    with StreamReader.open(stream) as reader:
        in_order = list(reader.iterate())
        assert all(same(a, b) for a, b in zip(reader.iterate(3), in_order[3:], strict=True))
        assert len(list(reader.iterate(2, 6))) == 4


def test_from_many_threads(stream):
    with StreamReader.open(stream) as reader:
        in_order = list(reader.iterate())
        wanted = [7, 0, 5, 2, 9, 1] * 4
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(reader.gaussians, wanted))
        assert all(same(frame, in_order[index]) for index, frame in zip(wanted, found, strict=True))


@pytest.mark.parametrize("index", [-1, 10, 10**9])
def test_no_such_frame(stream, index):
    with StreamReader.open(stream) as reader, refuses("stream.no_such_frame", value=index, frame_count=10):
        reader.gaussians(index)


def test_verify(stream):
    with StreamReader.open(stream) as reader:
        reader.verify()


def test_folder_that_is_none(tmp_path):
    with refuses("source.not_found", file=tmp_path / "nothing"):
        StreamReader.open(tmp_path / "nothing")
    with refuses("source.file_missing", file=tmp_path / "manifest.json"):
        StreamReader.open(tmp_path)
