"""Frames in any order, as a window wants them."""

from contextlib import closing
from pathlib import Path

import pytest

from tests.support.streams import video_file
from tests.support.waiting import wait_until
from v3studio.studio.errors import StudioError
from v3studio.studio.playback import LeftOut, StreamFrames, stream_frames
from v3studio.studio.stream import DecodedFrame, GroupDecoder, StreamReader


def test_frames_in_any_order_are_the_ones_that_were_baked(stream: Path) -> None:
    with StreamReader.open(stream) as reader, closing(StreamFrames(reader, loop=True)) as frames:
        for wanted in (3, 15, 0, 1, 9, 8, 14, 15, 0, 4, 5, 2):
            played = frames.get(wanted)
            assert (played.frame, round(played.gaussians.means[0, 0].item())) == (wanted, wanted)
        assert 3 < frames.get(7, 3).frame <= 7


def test_a_damaged_group_is_tried_again_after_a_while(stream: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_frames, "RETRY_SECONDS", 1e9)
    file = video_file(stream, 1)
    content = file.read_bytes()
    file.unlink()
    with StreamReader.open(stream) as reader, closing(StreamFrames(reader)) as frames:
        with pytest.raises(LeftOut) as caught:
            frames.get(7)
        assert (caught.value.stop, [group.group for group in frames.skipped]) == (9, [1])
        assert frames.get(7, 3).frame == 4  # the last one that can be played
        file.write_bytes(content)
        with pytest.raises(LeftOut):
            frames.get(6)
        fetch, known = reader.fetch, []
        monkeypatch.setattr(reader, "fetch", lambda group: known.append(frames.skipped) or fetch(group))
        monkeypatch.setattr(stream_frames, "RETRY_SECONDS", 0)
        assert frames.get(6).frame == 6
        assert (len(known[0]), frames.skipped) == (1, ())  # it is known as damaged until it is there


def test_a_late_viewer_passes_over_damaged_groups(stream: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video_file(stream, 2).unlink()
    read = GroupDecoder.read

    def damaged(decoder: GroupDecoder) -> DecodedFrame:
        if decoder.next_frame == 6:
            raise StudioError("stream.damaged", "damaged")
        return read(decoder)

    monkeypatch.setattr(GroupDecoder, "read", damaged)
    with StreamReader.open(stream) as reader, closing(StreamFrames(reader)) as frames:
        assert frames.get(5).frame == 5
        wait_until("both are known", lambda: len(frames.skipped) == 2)
        assert frames.get(15, 5).frame >= 10


def test_all_is_fetched_and_decoded_once_for_a_slow_viewer(long_stream: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_frames, "_KEPT_GROUPS", 1)
    made = []
    for name in ("_fetch", "_decode"):
        work = getattr(StreamFrames, name)
        noted = lambda self, job, name=name, work=work: made.append((name, job)) or work(self, job)  # noqa: E731
        monkeypatch.setattr(StreamFrames, name, noted)
    monkeypatch.setattr(stream_frames, "_GROUPS_AHEAD", 2)
    with StreamReader.open(long_stream) as reader, closing(StreamFrames(reader)) as frames:
        for wanted in range(84):
            frames.get(wanted)
            ahead = range(wanted, min(wanted + stream_frames.AHEAD + 1, 84))
            wait_until("ahead", lambda last=ahead[-1]: last in [job[0] for name, job in made if name == "_decode"])
    assert [job for name, job in made if name == "_fetch"] == list(range(6))
    assert [job[0] for name, job in made if name == "_decode"] == list(range(84))
