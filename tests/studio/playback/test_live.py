"""Players follow a live stream: they wait at its end for the next group, and end when it is complete."""

import pytest
import torch

from studio.gaussians import Gaussians
from studio.playback import Player, follow, play_headless
from studio.playback.shared import Shared
from studio.stream import BakeSettings, StreamReader, bake_group, write_manifest
from tests.support.errors import refuses

SETTINGS = BakeSettings(preset="ultrafast")


@pytest.fixture
def publish(tmp_path, monkeypatch):
    """`publish(groups, live, fps)`: the first groups of 3 frames of a stream; returns its folder."""
    monkeypatch.setattr(follow, "_SHORTEST", 0.01)
    entries = []

    def write(groups, live=True, fps=50):
        while len(entries) < groups:
            quats = torch.tensor([[1.0, 0, 0, 0]]).repeat(20, 1)
            frame = Gaussians(torch.rand(20, 3), quats, -3 * torch.ones(20, 3), torch.zeros(20), torch.zeros(20, 1, 3))
            number = len(entries)
            entries.append(bake_group([frame] * 3, tmp_path, number, 3 * number, SETTINGS, fps=50))
        write_manifest(tmp_path, entries[:groups], fps, SETTINGS, live=live)
        return tmp_path

    return write


def test_it_waits_for_the_next_group(publish, clock, until):
    with Player(publish(1), now=clock, loop=True) as player:
        until(lambda: player.frame() is not None)
        player.play()
        for frame in (1, 2):
            clock.forward(1)
            until(lambda frame=frame: player.frame().frame == frame)
        clock.forward(30)
        assert player.frame().frame == 2
        assert player.playing
        assert player.live
        assert player.buffering
        publish(3)
        until(lambda: player.frame().frame == 3)  # no matter how long it has waited
        for frame in (4, 5, 6, 7, 8):
            clock.forward(1)
            until(lambda frame=frame: player.frame().frame == frame)
        clock.forward(9)
        assert player.frame().frame == 8
        assert player.dropped == 0
        player.seek(1)
        player.seek_live()
        until(lambda: player.frame().frame == 6 and not player.buffering)
        publish(3, live=False)
        until(lambda: not player.live)
        clock.forward(3)
        until(lambda: player.frame() is not None and player.frame().frame == 0)  # it loops now
        assert player.playing


def test_headless_it_plays_to_the_end(publish):
    def more(item):
        if item.frame in (2, 5):
            publish(item.frame // 3 + 2, live=item.frame < 5)

    report = play_headless(publish(1), on_frame=more)
    assert [frame.frame for frame in report.frames] == list(range(9))


def test_another_stream_in_its_place_is_refused_at_the_end(publish, clock, until):
    with Player(publish(2), now=clock) as player:
        until(lambda: player.frame() is not None)
        player.play()
        publish(2, fps=25)
        clock.forward(5)

        def at_end():
            clock.forward(1)
            player.frame()
            return False

        with refuses("stream.live_changed", value=["fps"]):
            until(at_end)
        assert not player.playing


def test_waiting_for_more_ends_with_the_stream_or_on_request(publish):
    with StreamReader.open(publish(2)) as reader:
        shared = Shared(reader)
        assert shared.wait_for_more(1, lambda: False) is True
        assert shared.wait_for_more(2, lambda: True) is False
        turns = iter((False, False, True))
        assert shared.wait_for_more(2, lambda: next(turns)) is False
        publish(2, live=False)
        assert reader.refresh() or not reader.live
        assert shared.wait_for_more(2, lambda: False) is False
