"""The thread that follows a live stream tells what it found."""

import threading
from typing import Any, cast

import pytest

from studio.errors import StudioError
from studio.playback import follow
from studio.stream import SourceUnavailable, StreamReader


class Source:
    """A reader whose answers are given: True or False for new groups or none, or an error."""

    fps, frame_count, group_starts = 25.0, 30, (0, 15)

    def __init__(self, *answers: Any) -> None:
        self.answers, self.live, self.asked = list(answers), True, 0

    def refresh(self) -> bool:
        self.asked += 1
        if not self.answers:
            self.live = False
            return False
        answer = self.answers.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return bool(answer)


def followed(monkeypatch: pytest.MonkeyPatch, source: Source) -> tuple[list[int], list[StudioError], follow.Follower]:
    """After how many reads it grew, and with what it was lost, once the thread has ended."""
    monkeypatch.setattr(follow, "SHORTEST", 0.001)
    monkeypatch.setattr(follow, "LONGEST", 0.001)
    grown: list[int] = []
    lost: list[StudioError] = []
    follower = follow.Follower(cast("StreamReader", source), lambda: grown.append(source.asked), lost.append)
    for thread in threading.enumerate():
        if thread.name == "playback-follow":
            thread.join(60)
            assert not thread.is_alive()
    return grown, lost, follower


def test_new_groups_are_told_while_it_is_live_and_so_is_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    grown, lost, follower = followed(monkeypatch, Source(True, False, False, True))
    assert grown == [1, 4, 5]  # not after the reads that found nothing; the fifth is the end
    assert lost == []
    follower.close()


def test_what_is_away_for_a_while_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    away = SourceUnavailable("stream.unreachable", "The server does not answer.")
    damaged = StudioError("stream.manifest", "The manifest ends in the middle.")
    grown, lost, follower = followed(monkeypatch, Source(away, damaged, True))
    assert grown == [3, 4]
    assert lost == []
    follower.close()


def test_another_stream_in_its_place_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    other = StudioError("stream.live_changed", "This is another stream.")
    source = Source(True, other, True)
    grown, lost, follower = followed(monkeypatch, source)
    assert (grown, lost, source.asked) == ([1], [other], 2)
    follower.close()
