"""A live stream is followed: playback waits at its end for the next group, and ends when it is complete."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.errors import refuses
from tests.support.streams import bake_numbered
from v3studio.studio.playback import follow, play_headless
from v3studio.studio.stream import BakeSettings


@pytest.fixture
def publish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """`publish(groups, live, fps)`: the first groups of 3 frames of a stream; returns its folder."""
    monkeypatch.setattr(follow, "SHORTEST", 0.01)

    def write(groups, live=True, fps=50):
        return bake_numbered(tmp_path, (3,) * groups, fps, 20, BakeSettings(preset="ultrafast"), live=live)

    return write


@pytest.mark.parametrize("realtime", [False, True])
def test_it_waits_for_the_next_group_and_plays_to_the_end(publish: Callable[..., Path], realtime: bool) -> None:
    seen = []

    def more(item):
        seen.append(item.frame)
        if item.frame in (2, 5):
            time.sleep(0.1)  # several frames long; the clock waits all the same
            publish(item.frame // 3 + 2, live=item.frame < 5)

    report = play_headless(publish(1), realtime=realtime, on_frame=more)
    assert seen == list(range(9)) if not realtime else {2, 3, 5, 6, 8} <= set(seen)
    assert report.shown + report.dropped == 9


@pytest.mark.parametrize("realtime", [False, True])
def test_another_stream_in_its_place_is_refused_at_the_end(publish: Callable[..., Path], realtime: bool) -> None:
    folder, seen = publish(2), []

    def replace(item):
        seen.append(item.frame)
        if len(seen) == 1:
            publish(2, fps=25)

    with refuses("stream.live_changed", value=["fps"]):
        play_headless(folder, realtime=realtime, on_frame=replace)
    assert seen[-1] == 5
