"""The clock and the sound that leads it."""

from __future__ import annotations

import pytest

from studio.playback.clock import Clock


class Sound:
    """Records what it is told; plays from there at the pace that `later` gives."""

    def __init__(self) -> None:
        self.told: list[object] = []
        self.at: float | None = 0.0

    def play(self, seconds: float, loop: bool) -> None:
        self.told.append((seconds, loop))
        self.at = seconds

    def stop(self) -> None:
        self.told.append("stop")

    def position(self) -> float | None:
        return self.at

    def last(self) -> object:
        """What it was told since the last look; "nothing", or the last of it."""
        found = self.told[-1] if self.told else "nothing"
        self.told.clear()
        return found


@pytest.fixture
def sound() -> Sound:
    return Sound()


def clock_with(sound: Sound, loop: bool = False) -> Clock:
    """Of 50 frames at 25 frames per second; its own time stands still, so it moves with the sound only."""
    return Clock(25.0, 50, loop, 1.0, lambda: 0.0, sound)


def test_sound_plays_only_while_the_frames_do(sound: Sound) -> None:
    clock = clock_with(sound)
    clock.cue(10)
    assert sound.last() == "stop"
    clock.playing = True
    assert sound.last() == "stop"  # the first frame is not there
    clock.frame_is_ready(10)
    assert sound.last() == (0.4, False)
    sound.at = 0.8
    assert clock.due() == 20
    clock.hold(20)
    assert sound.last() == "stop"
    sound.at = 1.0
    assert clock.due() == 20  # it waits
    clock.frame_is_ready(21)
    assert sound.last() == (0.84, False)
    clock.playing = False
    assert sound.last() == "stop"


def test_at_another_rate_it_is_silent(sound: Sound) -> None:
    clock = clock_with(sound)
    clock.playing = True
    clock.frame_is_ready(0)
    assert sound.last() == (0.0, False)
    clock.rate = 2.0
    assert sound.last() == "stop"
    clock.rate = 1.0
    assert sound.last() == (0.0, False)


def test_looping_is_told_and_the_end_is_silent(sound: Sound) -> None:
    clock = clock_with(sound)
    clock.playing = True
    clock.loop = True
    clock.cue(0)
    clock.frame_is_ready(0)
    assert sound.last() == (0.0, True)
    clock.loop = False
    clock.cue(40)
    sound.last()
    clock.nothing_will_come()
    assert sound.last() == "stop"  # at the end
    assert clock.due() == 49


def test_frames_go_on_without_a_sound_that_fails(sound: Sound) -> None:
    now = [0.0]
    clock = Clock(25.0, 50, False, 1.0, lambda: now[0], sound)
    clock.playing = True
    clock.frame_is_ready(0)
    sound.at = 0.4
    assert clock.due() == 10
    now[0], sound.at = 7.0, None
    assert clock.due() == 10  # from the sound's last tick on
    now[0] = 7.2
    assert clock.due() == 15
