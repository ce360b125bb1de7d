"""The thread that follows a live stream tells what it found."""

import threading

import pytest

from studio.errors import StudioError
from studio.playback import follow
from studio.stream import SourceUnavailable

AWAY = SourceUnavailable("stream.unreachable", "The server does not answer.")
DAMAGED = StudioError("stream.manifest", "The manifest ends in the middle.")
OTHER = StudioError("stream.live_changed", "This is another stream.")


class Source:
    """A reader whose answers are given: True or False for new groups or none, or an error."""

    fps, frame_count, index = 25.0, 30, (0, 15)

    def __init__(self, *answers):
        self.answers, self.live, self.asked = list(answers), True, 0

    def refresh(self):
        self.asked += 1
        if not self.answers:
            self.live = False
            return False
        answer = self.answers.pop(0)
        if isinstance(answer, StudioError):
            raise answer
        return answer


@pytest.mark.parametrize(
    ("answers", "grown", "lost"),
    [
        ((True, False, False, True), [1, 4, 5], []),  # not after the reads that found nothing; the fifth is the end
        ((AWAY, DAMAGED, True), [3, 4], []),  # tried again
        ((True, OTHER, True), [1], [OTHER]),  # another stream in its place ends it
    ],
)
def test_what_is_told_after_which_reads(monkeypatch, answers, grown, lost):
    monkeypatch.setattr(follow, "SHORTEST", 0.001)
    monkeypatch.setattr(follow, "LONGEST", 0.001)
    source, found, missed = Source(*answers), [], []
    with follow.following(source, lambda: found.append(source.asked), missed.append):
        for thread in threading.enumerate():
            if thread.name == "playback-follow":
                thread.join(60)
                assert not thread.is_alive()
    assert (found, missed, source.asked) == (grown, lost, max(grown) + len(lost))
