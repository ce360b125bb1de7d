from pathlib import Path

import pytest

from tests.support.errors import refuses
from v3studio.studio.errors import Cancelled
from v3studio.studio.playback import play_headless
from v3studio.studio.stream import StreamReader


def test_all_frames_in_order(stream: Path) -> None:
    seen = []
    report = play_headless(stream, on_frame=lambda played: seen.append(round(played.gaussians.means[0, 0].item())))
    assert seen == list(range(16))
    assert (report.shown, report.dropped) == (16, 0)
    assert [stats.frame for stats in report.frames] == list(range(16))
    assert [stats.group for stats in report.frames] == [0] * 5 + [1] * 4 + [2] + [3] * 6
    for stats in report.frames:
        assert stats.fetch_ms > 0
        assert stats.decode_ms > 0
        assert stats.dequantize_ms > 0
    with StreamReader.open(stream) as reader:
        files = sum(group.bytes for group in reader.groups)
    assert sum(stats.bytes for stats in report.frames) == pytest.approx(files)


def test_report_as_json(stream: Path) -> None:
    report = play_headless(stream, frame_limit=4)
    values = report.to_dict()
    assert values["shown"] == 4
    assert len(values["frames"]) == 4
    decode = [stats.decode_ms for stats in report.frames]
    assert values["summary"]["decode_ms"]["max"] == max(decode)
    assert values["summary"]["decode_ms"]["mean"] == pytest.approx(sum(decode) / 4)


def test_part_of_a_stream(stream: Path) -> None:
    with StreamReader.open(stream) as reader:
        report = play_headless(reader, start_frame=7, frame_limit=5)
        assert [stats.frame for stats in report.frames] == [7, 8, 9, 10, 11]
        assert len(reader.gaussians(0)) == 40  # the caller's reader stays open


def test_by_the_clock(stream: Path) -> None:
    seen = []
    report = play_headless(stream, realtime=True, on_frame=lambda played: seen.append(played.frame))
    assert seen == sorted(set(seen))
    assert seen[-1] == 15
    assert report.shown + report.dropped == 16
    assert report.seconds >= 15 / 50 - 0.01  # never faster than the stream's rate


def test_errors_reach_the_caller(stream: Path, tmp_path: Path) -> None:
    for realtime in (False, True):
        with refuses("source.not_found", file=tmp_path / "none"):
            play_headless(tmp_path / "none", realtime=realtime)
        with refuses("stream.no_such_frame", value=16, frame_count=16):
            play_headless(stream, realtime=realtime, start_frame=16)


def test_cancelling_passes_through(stream: Path) -> None:
    def stop(played):
        raise Cancelled

    for realtime in (False, True):
        with pytest.raises(Cancelled):
            play_headless(stream, realtime=realtime, on_frame=stop)
