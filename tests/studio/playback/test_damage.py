"""Damaged and missing groups are skipped and reported, and playback continues."""

import json
from pathlib import Path

import pytest

from tests.support.errors import refuses
from tests.support.streams import best_of, damage, edit_manifest, put_file, video_file
from v3studio.studio.playback import play_headless
from v3studio.studio.stream import Source, SourceUnavailable


def number(played) -> int:
    return round(played.gaussians.means[0, 0].item())


@pytest.mark.parametrize("realtime", [False, True])
@pytest.mark.parametrize(
    ("how", "code"),
    [("missing", "source.file_missing"), ("flipped", "stream.wrong_checksum"), ("truncated", "stream.wrong_size")],
)
def test_goes_on_with_the_next_intact_group(stream: Path, realtime: bool, how: str, code: str) -> None:
    path = video_file(stream, 1)
    damage(path, how)
    seen = []
    report = play_headless(stream, realtime=realtime, on_frame=lambda played: seen.append(number(played)))
    intact = [0, 1, 2, 3, 4, *range(9, 16)]
    assert set(seen) <= set(intact)
    assert seen == sorted(seen)
    assert seen[-1] == 15
    assert report.shown + report.dropped == len(intact)
    if not realtime:
        assert seen == intact
    (skipped,) = report.skipped
    assert (skipped.group, skipped.first_frame, skipped.frame_count) == (1, 5, 4)
    assert (skipped.cause.code, str(skipped.cause.file)) == (code, str(path))
    assert "frames 5 to 8" in str(skipped)
    assert str(skipped.cause) in str(skipped)
    written = json.loads(json.dumps(report.to_dict()))["skipped"][0]
    assert (written["group"], written["code"], written["reason"]) == (1, code, str(skipped.cause))


@pytest.mark.parametrize("realtime", [False, True])
def test_where_nothing_is_intact_it_is_an_error(stream: Path, realtime: bool) -> None:
    for group in range(4):
        video_file(stream, group).unlink()
    file = video_file(stream, 0)
    with refuses("playback.nothing_playable", file=file, cause="source.file_missing", group=0):
        play_headless(stream, realtime=realtime)


def test_only_what_was_to_be_played_is_reported(stream: Path) -> None:
    video_file(stream, 1).unlink()
    assert play_headless(stream, frame_limit=5).skipped == ()
    assert play_headless(stream, frame_limit=6).skipped != ()
    assert play_headless(stream, start_frame=9).skipped == ()


def test_a_picture_that_cannot_be_decoded(stream: Path) -> None:
    """Names and checksums match here: the manifest is updated to the damaged file."""
    file = video_file(stream, 0)
    data = bytearray(file.read_bytes())
    middle = data.rindex(b"mdat") + (len(data) - data.rindex(b"mdat")) // 2
    data[middle:] = bytes(len(data) - middle)

    def change(values):
        put_file(stream, best_of(values["groups"][0])["video"], bytes(data))

    edit_manifest(stream, change)
    seen = []
    report = play_headless(stream, on_frame=lambda played: seen.append(number(played)))
    (skipped,) = report.skipped
    assert 0 <= skipped.first_frame < 5
    assert skipped.first_frame + skipped.frame_count == 5
    assert seen == [*range(skipped.first_frame), *range(5, 16)]
    assert skipped.cause.code in ("stream.video_damaged", "stream.video_too_short", "stream.wrong_luma")
    assert skipped.cause.file == str(video_file(stream, 0))


class Dead(Source):
    """A source whose server disappears after the second group. Only the videos are a group's own."""

    name = "http://dead"

    def __init__(self, folder):
        self.folder, self.tried = folder, []
        self.own = {video_file(folder, group): group for group in range(6)}

    def read(self, path, limit):
        group = self.own.get(self.folder / path)
        if group is not None and group not in self.tried:
            self.tried.append(group)
        if group is not None and group > 1:
            raise SourceUnavailable("source.unavailable", "the server refuses the connection", file=path)
        return (self.folder / path).read_bytes()


@pytest.mark.parametrize("realtime", [False, True])
def test_a_server_that_stays_away_ends_it(long_stream: Path, realtime: bool) -> None:
    source = Dead(long_stream)
    seen = []
    with pytest.raises(SourceUnavailable):
        play_headless(source, realtime=realtime, on_frame=lambda played: seen.append(number(played)))
    assert seen[-1] == 27
    assert source.tried == [0, 1, 2, 3]
