"""Start timecodes: labels counted one by one, and offsets of videos that FFmpeg wrote with a tmcd track."""

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.capture.timecode import parse_timecode, read_timecode, timecode_offsets
from v3studio.studio.footage import open_footage
from v3studio.studio.footage.sync import check_sync

NTSC = Fraction(30000, 1001)
GRAY = 70  # of the frame at which the latest camera starts; each later one is 8 brighter


def film(path: Path, timecode: str | None, early: int = 0, rate: Fraction | int = 25, frames: int = 16) -> None:
    """A video of gray images that tell the time; `early` frames before the time 0 it begins."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"qp": "0"})
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        if timecode is not None:
            stream.metadata["timecode"] = timecode
        for frame in range(frames):
            gray = np.full((48, 32), GRAY + 8 * (frame - early), np.uint8)  # YUV planes: luma, then chroma
            gray[32:] = 128
            container.mux(stream.encode(av.VideoFrame.from_ndarray(gray, "yuv420p")))
        container.mux(stream.encode())


def labels(fps: int, dropped: int) -> Iterator[str]:
    """Drop-frame labels of an hour, by counting and skipping."""
    for minute in range(60):
        for second in range(60):
            first = dropped if minute % 10 and second == 0 else 0
            yield from (f"00:{minute:02}:{second:02};{frame:02}" for frame in range(first, fps))


@pytest.mark.parametrize(("fps", "dropped"), [(30, 2), (60, 4)])
def test_drop_frame_labels_are_counted(fps: int, dropped: int) -> None:
    rate = Fraction(fps * 1000, 1001)
    count = 0
    for count, label in enumerate(labels(fps, dropped)):
        if count % 977 == 0 or label.endswith(f";{dropped:02}"):
            assert parse_timecode(label, rate).frames == count
    assert parse_timecode("00:00:00;00", rate).day == 24 * (count + 1)
    # they keep up with the clock: after an hour, by less than a frame
    assert parse_timecode("01:00:00;00", rate).frames == count + 1
    assert abs(float(parse_timecode("01:00:00;00", rate).frames / rate) - 3600) < 0.004


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        *((text, Fraction(25)) for text in ("noon", "24:00:00:00", "00:60:00:00", "00:00:00:25")),
        ("00:01:00;01", NTSC),  # dropped
        ("00:01:00;02", Fraction(25)),  # nothing is dropped at 25 fps
        ("00:01:00;02", Fraction(30)),
    ],
)
def test_a_label_that_does_not_exist_is_refused(text: str, rate: Fraction) -> None:
    with refuses("sync.timecode_invalid", value=text):
        parse_timecode(text, rate)


@pytest.mark.parametrize("ending", ["mov", "mp4"])
@pytest.mark.parametrize(
    ("text", "rate"), [("01:00:00;02", NTSC), ("10:11:12:13", Fraction(25)), ("23:59:59;58", 2 * NTSC)]
)
def test_the_frame_is_the_one_in_the_tmcd_track(tmp_path: Path, ending: str, text: str, rate: Fraction) -> None:
    path = tmp_path / f"a.{ending}"
    film(path, text, rate=rate)
    code = read_timecode(path)
    assert code.text == text
    with av.open(str(path)) as container:
        (track,) = container.streams.data
        sample = next(bytes(packet) for packet in container.demux(track) if packet.size)
    assert code.frames == int.from_bytes(sample[:4], "big")


def capture(folder: Path, **videos: tuple[str | None, int]) -> CaptureSettings:
    (folder / "videos").mkdir()
    for name, (text, early) in videos.items():
        film(folder / "videos" / f"{name}.mov", text, early)
    return CaptureSettings(root=folder, masks="none")


@pytest.mark.parametrize(
    "texts", [("01:00:00:05", "01:00:00:02", "01:00:00:00"), ("00:00:00:01", "23:59:59:23", "23:59:59:21")]
)
def test_cameras_that_started_at_different_times_are_aligned(tmp_path: Path, texts: tuple[str, str, str]) -> None:
    spec = capture(tmp_path, a=(texts[0], 0), b=(texts[1], 3), c=(texts[2], 5))
    report = check_sync(open_footage(spec), method="timecode")
    assert report.whole == {"a": -3, "c": 2}, "b, in the middle, stays"
    assert report.timecodes == dict(zip("abc", texts, strict=True))
    aligned = open_footage(spec.replace(offsets=report.whole))
    assert aligned.frames == tuple(range(3, 14)), "what all three filmed"
    for frame in aligned.frames:
        grays = [aligned.raw_image(name, frame).mean() for name in "abc"]
        assert np.ptp(grays) < 0.5


def test_a_camera_without_one_is_named(tmp_path: Path) -> None:
    spec = capture(tmp_path, a=("01:00:00:05", 0), b=("01:00:00:02", 3), c=(None, 0))
    report = check_sync(open_footage(spec), method="timecode")
    assert report.unsure == ("c",)
    assert "'c'" in str(report.warnings()[-1])
    assert set(report.offsets) == {"a", "b"}
    with refuses("sync.no_timecode", value=1):
        check_sync(open_footage(spec.replace(cameras=("a", "c"))), method="timecode")


def test_videos_that_do_not_overlap(tmp_path: Path) -> None:
    spec = capture(tmp_path, a=("01:00:00:00", 0), b=("01:00:00:16", 0))
    with refuses("sync.no_overlap", cameras=("a", "b")):
        check_sync(open_footage(spec), method="timecode")


def test_rates_and_kinds_that_differ() -> None:
    first, thirty, dropping = (
        parse_timecode(*code) for code in (("01:00:00:00", NTSC), ("01:00:00:00", Fraction(30)), ("01:00:00;00", NTSC))
    )
    with refuses("sync.rates_differ", cameras=("b", "a")):
        timecode_offsets({"a": thirty, "b": first})
    with refuses("sync.timecode_mixed", cameras=("b", "a")):
        timecode_offsets({"a": first, "b": dropping})


def test_a_track_that_counts_at_another_rate_is_refused(tmp_path: Path) -> None:
    """Timecodes are as those of cameras that film 50 frames per second and count to 25."""
    path = tmp_path / "a.mov"
    film(path, "01:00:00:02", rate=50)
    data = bytearray(path.read_bytes())
    place = re.search(rb"stsd.{12}tmcd", data, re.DOTALL).end() - 4
    duration = slice(place + 24, place + 28)  # of a frame, in the sample description
    data[duration] = (2 * int.from_bytes(data[duration], "big")).to_bytes(4, "big")
    data[place + 28] //= 2  # frames per second
    path.write_bytes(data)
    with refuses("sync.timecode_rate", file=path):
        read_timecode(path)


@pytest.mark.parametrize(
    "text", ["01:00:00:" + "1" * 5000, "01:00:00:" + "\N{ARABIC-INDIC DIGIT TWO}" * 2, "\x1b" * 9000]
)
def test_a_hostile_tag_is_one_short_sentence(text: str) -> None:
    with refuses("sync.timecode_invalid") as caught:
        parse_timecode(text, Fraction(25))
    assert len(caught.value.problem) < 100
