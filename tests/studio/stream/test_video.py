"""B-frames: the order in the file, the order that decoders return, and where they are allowed."""

from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from tests.studio.stream.conftest import turned_bodies
from v3studio.studio.stream import BakeSettings, bake_group
from v3studio.studio.stream.video import PlaneDecoder, PlaneEncoder

SIZE = (64, 48)


def pictures(count):
    """Noise, and a number of its own in a corner of each picture."""
    result = np.random.default_rng(0).integers(90, 110, (count, SIZE[1], SIZE[0]), dtype=np.uint8)
    for index, picture in enumerate(result):
        picture[:16, :16] = 20 + 10 * index
    return result


@pytest.mark.parametrize("b_frames", [1, 2, 3, 7])
def test_opencv_returns_the_same_in_the_same_order(tmp_path: Path, b_frames: int) -> None:
    path = tmp_path / "a.mp4"
    encoder = PlaneEncoder(path, SIZE, 24, "veryfast", b_frames)
    for plane in pictures(11):
        encoder.add(plane)
    encoder.close()
    decoder = PlaneDecoder(path.read_bytes(), "test", SIZE, 11)
    capture, picture = cv2.VideoCapture(str(path)), np.empty(SIZE[::-1], np.uint8)
    for index in range(11):
        decoder.read(picture)
        ok, theirs = capture.read()
        assert ok
        assert np.array_equal(cv2.cvtColor(theirs, cv2.COLOR_BGR2GRAY), picture)
        assert abs(int(picture[4, 4]) - (20 + 10 * index)) < 5
    assert not capture.read()[0]
    decoder.close()


SHORT = ([1], [1, 2], [1, 3, 2])
"""Shorter than the run of B-frames."""


@pytest.mark.parametrize(
    ("settings", "types"),
    [
        ({}, [1, 3, 3, 3, 3, 3, 2]),  # I, then B before each P
        ({"b_frames": 0}, [1, 2, 2, 2, 2, 2, 2]),
        ({"b_frames": 1}, [1, 3, 2, 3, 2, 3, 2]),
        *(({}, types) for types in SHORT),
    ],
)
def test_how_many_there_are(tmp_path: Path, settings: dict[str, Any], types: list[int]) -> None:
    chosen = BakeSettings(**{"preset": "veryfast", "quality": 24, **settings})
    entry = bake_group(turned_bodies(len(types), splats=60), tmp_path, 0, 0, chosen)
    with av.open(str(tmp_path / entry.best.video.path)) as container:
        assert [int(frame.pict_type) for frame in container.decode(video=0)] == types
