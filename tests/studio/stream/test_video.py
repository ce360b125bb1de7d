"""B-frames: the order in the file, the order that decoders return, and where they are allowed."""

import av
import cv2
import numpy as np
import pytest

from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from studio.stream.video import PlaneDecoder, PlaneEncoder
from tests.support.settings import refuses_setting

SIZE = (64, 48)


def pictures(count):
    """Noise, and a number of its own in a corner of each picture."""
    result = np.random.default_rng(0).integers(90, 110, (count, SIZE[1], SIZE[0]), dtype=np.uint8)
    for index, picture in enumerate(result):
        picture[:16, :16] = 20 + 10 * index
    return result


def encode(path, planes, codec="h264", qp=24, b_frames=3):
    encoder = PlaneEncoder(path, SIZE, qp, "veryfast", tiles=codec, b_frames=min(b_frames, max(len(planes) - 2, 0)))
    for plane in planes:
        encoder.add(plane)
    encoder.close()
    return path


def decoded(path, count, codec="h264"):
    decoder = PlaneDecoder(path.read_bytes(), "test", SIZE, count, codec)
    result = np.empty((count, *SIZE[::-1]), dtype=np.uint8)
    for picture in result:
        decoder.read(picture)
    decoder.close()
    return result


@pytest.mark.parametrize("b_frames", [1, 2, 3, 7])
def test_opencv_returns_the_same_in_the_same_order(tmp_path, b_frames):
    path = encode(tmp_path / "a.mp4", pictures(11), b_frames=b_frames)
    ours = decoded(path, 11)
    capture = cv2.VideoCapture(str(path))
    for index, picture in enumerate(ours):
        ok, theirs = capture.read()
        assert ok
        assert np.array_equal(cv2.cvtColor(theirs, cv2.COLOR_BGR2GRAY), picture)
        assert abs(int(picture[4, 4]) - (20 + 10 * index)) < 5
    assert not capture.read()[0]


def test_b_pictures_are_between_p_pictures(tmp_path):
    path = encode(tmp_path / "a.mp4", pictures(9))
    with av.open(str(path)) as container:
        types = [int(frame.pict_type) for frame in container.decode(video=0)]
    assert types == [1, 3, 3, 3, 2, 3, 3, 3, 2]  # I, then three B before each P
    with av.open(str(path)) as container:
        times = [packet.pts for packet in container.demux(video=0) if packet.pts is not None]
    assert times != sorted(times)
    assert len(set(times)) == 9


def picture_types(folder):
    with StreamReader.open(folder) as reader:
        group = reader.groups[0]
    with av.open(str(folder / group.video.path)) as container:
        return [int(frame.pict_type) for frame in container.decode(video=0)]


@pytest.mark.parametrize(
    ("settings", "types"),
    [
        ({}, [1, 3, 3, 3, 3, 3, 2]),
        ({"b_frames": 0}, [1, 2, 2, 2, 2, 2, 2]),
        ({"b_frames": 1, "codec": "hevc"}, [1, 3, 2, 3, 2, 3, 2]),
    ],
)
def test_how_many_there_are(tmp_path, turning_bodies, settings, types):
    chosen = BakeSettings(preset="veryfast", quality=24, **settings)
    entry = bake_group(turning_bodies(7, splats=60), tmp_path, 0, 0, chosen)
    write_manifest(tmp_path, [entry], 30, chosen)
    assert picture_types(tmp_path) == types


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("codec", ["h264", "hevc"])
def test_short_groups(tmp_path, turning_bodies, frames, codec):
    """Shorter than the run of B-frames."""
    settings = BakeSettings(preset="veryfast", quality=24, codec=codec)
    entry = bake_group(turning_bodies(frames, splats=60), tmp_path, 0, 0, settings)
    write_manifest(tmp_path, [entry], 30, settings)
    assert picture_types(tmp_path) == [[1], [1, 2], [1, 3, 2]][frames - 1]


def test_settings_that_cannot_have_them():
    with refuses_setting("b_frames", "codec"):
        BakeSettings(b_frames=2, codec="av1")
    with refuses_setting("b_frames", "profile"):
        BakeSettings(b_frames=2, profile="planes")
    with refuses_setting("smooth_paths", "profile"):
        BakeSettings(smooth_paths=True, profile="planes")
