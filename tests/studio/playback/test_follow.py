"""The thread that follows a live stream tells what it found."""

import threading

import pytest

from v3studio.studio.errors import StudioError
from v3studio.studio.playback import follow
from v3studio.studio.stream import SourceUnavailable

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
    ("answers", "reads", "lost"),
    [
        ((True, False, False, True), 5, []),  # the fifth is the end
        ((AWAY, DAMAGED, True), 4, []),  # tried again
        ((True, OTHER, True), 2, [OTHER]),  # another stream in its place ends it
    ],
)
def test_what_is_read_and_told(
    monkeypatch: pytest.MonkeyPatch, answers: tuple[bool | StudioError, ...], reads: int, lost: list[StudioError]
) -> None:
    monkeypatch.setattr(follow, "SHORTEST", 0.001)
    monkeypatch.setattr(follow, "LONGEST", 0.001)
    source = Source(*answers)
    with follow.following(source) as missed:
        for thread in threading.enumerate():
            if thread.name == "playback-follow":
                thread.join(60)
                assert not thread.is_alive()
    assert (source.asked, missed) == (reads, lost)
