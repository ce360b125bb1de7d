"""The player with a manual clock: it shows the due frame, in order, during all user actions."""

import random
import threading
import time
from pathlib import Path

import pytest

from studio.playback import Player
from studio.stream import StreamReader
from tests.support.errors import refuses
from tests.support.streams import opacity_file


def number(played) -> int:
    """The frame number encoded in the Gaussians."""
    found = round(played.gaussians.means[0, 0].item())
    assert found == played.frame
    return found


def shown(player) -> int | None:
    played = player.frame()
    return None if played is None else number(played)


@pytest.fixture
def player(gated, clock):
    with Player(gated, now=clock) as player:
        yield player


def test_first_frame_shows_while_paused(player, clock, until):
    until(lambda: shown(player) == 0)
    clock.forward(7)
    assert shown(player) == 0
    assert not player.playing
    assert player.position == 0


def test_plays_every_frame_in_order_to_the_end(player, clock, until):
    player.play()
    until(lambda: shown(player) == 0)
    for index in range(1, 16):
        clock.forward(1)
        until(lambda index=index: shown(player) == index, f"frame {index}")
        assert player.position == index
    assert not player.finished
    clock.forward(1)
    until(lambda: player.finished)
    assert shown(player) == 15
    assert not player.playing
    assert player.dropped == 0


def test_the_same_object_while_nothing_newer_is_due(player, clock, until):
    player.play()
    until(lambda: player.frame() is not None)
    first = player.frame()
    clock.forward(0.9)
    assert player.frame() is first


def test_clock_waits_for_the_first_frame(gated, clock, until):
    with StreamReader.open(gated) as reader:
        gated.gate.clear()
        with Player(reader, now=clock) as player:
            player.play()
            clock.forward(10)
            assert player.frame() is None
            assert player.position == 0
            gated.gate.set()
            until(lambda: shown(player) == 0)
            assert player.position == 0


def test_pause_and_go_on(player, clock, until):
    player.play()
    until(lambda: shown(player) == 0)
    clock.forward(3)
    until(lambda: shown(player) == 3)
    player.pause()
    clock.forward(100)
    assert shown(player) == 3
    player.play()
    clock.forward(1)
    until(lambda: shown(player) == 4)


def test_rate(player, clock, until):
    player.set_rate(2.0)
    player.play()
    until(lambda: shown(player) == 0)
    clock.forward(2)
    until(lambda: shown(player) == 4)
    player.set_rate(0.5)
    clock.forward(2)
    until(lambda: shown(player) == 5)
    for wrong in (0, -1, float("nan"), 1000):
        with refuses("playback.invalid_rate"):
            player.set_rate(wrong)


def test_late_frames_are_dropped_not_queued(player, clock, until):
    player.play()
    until(lambda: shown(player) == 0)
    clock.forward(13)
    seen = []

    def caught_up():
        index = shown(player)
        if not seen or seen[-1] != index:
            seen.append(index)
        return index == 13

    until(caught_up)
    assert seen == sorted(set(seen))
    assert player.dropped == 13 - len(set(seen) - {0})
    clock.forward(1)
    until(lambda: shown(player) == 14)


def test_a_reader_of_frames_that_rarely_looks_does_not_fall_behind(player, clock, until):
    player.play()
    until(lambda: shown(player) == 0)
    clock.forward(12)
    time.sleep(0.5)  # no consumer: the pipeline itself must drop frames
    until(lambda: player.dropped >= 8, "dropping by the pipeline")
    until(lambda: shown(player) == 12)


@pytest.mark.parametrize("playing", [False, True])
def test_seek_everywhere(player, clock, until, playing):
    if playing:
        player.play()
    for index in (9, 0, 15, 5, 4, 10, 3, 3):
        player.seek(index)
        assert player.buffering
        assert player.position == index
        until(lambda index=index: shown(player) == index and not player.buffering, f"frame {index}")
    assert player.playing is playing
    clock.forward(1)
    if playing:
        until(lambda: shown(player) == 4)
    else:
        assert shown(player) == 3


def test_old_frame_stays_until_the_new_one_is_there(gated, clock, until):
    with Player(gated, now=clock) as player:
        until(lambda: shown(player) == 0)
        until(lambda: 1 in gated.groups_read())
        gated.gate.clear()
        player.seek(12)
        assert shown(player) == 0
        assert player.position == 12
        gated.gate.set()
        until(lambda: shown(player) == 12)


def test_seeking_within_fetched_groups_reads_nothing_again(gated, clock, until):
    with Player(gated, now=clock) as player:
        until(lambda: shown(player) == 0)
        for index in (3, 1, 4, 0):
            player.seek(index)
            until(lambda index=index: shown(player) == index)
        file = opacity_file(Path(gated.name), 0)
        assert gated.reads.count(f"files/{file.name}") == 1


def test_no_such_frame(player):
    for wrong in (-1, 16):
        with refuses("stream.no_such_frame", value=wrong, frame_count=16):
            player.seek(wrong)


def test_next_group_is_prefetched(long_stream, gate, clock, until):
    source = gate(long_stream)
    with Player(source, now=clock) as player:
        until(lambda: shown(player) == 0)
        until(lambda: source.groups_read() == [0, 1, 2], "prefetch")
        time.sleep(0.2)
        assert source.groups_read() == [0, 1, 2]  # and no more: queues are bounded


def test_loop(gated, clock, until):
    with Player(gated, loop=True, start_frame=14, now=clock) as player:
        player.play()
        until(lambda: shown(player) == 14)
        for index in (15, 0, 1, 2):
            clock.forward(1)
            until(lambda index=index: shown(player) == index, f"frame {index}")
        assert player.frame().tick == 18
        clock.forward(32)  # two loops later
        until(lambda: player.frame().tick == 50)
        assert shown(player) == 2
        assert not player.finished


def test_loop_switched_on_and_off(player, clock, until):
    player.play()
    until(lambda: shown(player) == 0)
    player.seek(15)
    until(lambda: shown(player) == 15)
    player.set_loop(True)
    until(lambda: player.frame() and not player.buffering)
    clock.forward(1)
    until(lambda: shown(player) == 0)
    player.set_loop(False)
    player.seek(15)
    until(lambda: shown(player) == 15 and not player.buffering)
    clock.forward(1)
    until(lambda: player.finished)


def test_play_at_the_end_begins_again(player, clock, until):
    player.play()
    player.seek(15)
    until(lambda: shown(player) == 15)
    clock.forward(2)
    until(lambda: player.finished and shown(player) == 15)
    player.play()
    until(lambda: shown(player) == 0)
    assert player.playing


def test_close_ends_all_threads(gated, clock, until):
    before = {thread.name for thread in threading.enumerate()}
    for pause in (0.0, 0.02, 0.2):
        player = Player(gated, now=clock, loop=True)
        player.play()
        for index in (3, 12, 7):
            player.seek(index)
        time.sleep(pause)
        player.close()
        player.seek(2)  # after closing: nothing happens
    after = {thread.name for thread in threading.enumerate()}
    assert not {name for name in after - before if name.startswith(("playback", "decode"))}


def test_many_threads_at_once_never_see_frames_out_of_order(stream):
    """Real clock, loop, random seeks and pauses: each viewer sees frames of increasing (run, tick)."""
    rng = random.Random(3)
    stop = threading.Event()
    failures: list[str] = []
    looks = [0, 0, 0]
    with Player(stream, loop=True, rate=3.0) as player:
        player.play()

        def view(viewer):
            last = (-1, -1)
            while not stop.is_set():
                played = player.frame()
                if played is not None:
                    if round(played.gaussians.means[0, 0].item()) != played.frame or played.tick % 16 != played.frame:
                        failures.append(f"frame {played.frame} has the content of another")
                    if (played.run, played.tick) < last:
                        failures.append(f"{(played.run, played.tick)} after {last}")
                    looks[viewer] += (played.run, played.tick) > last
                    last = (played.run, played.tick)
                time.sleep(0.001)

        viewers = [threading.Thread(target=view, args=(viewer,)) for viewer in range(3)]
        for viewer in viewers:
            viewer.start()
        for _ in range(25):
            time.sleep(0.06)
            rng.choice((player.pause, player.play, lambda: player.seek(rng.randrange(16))))()
            player.play()
        stop.set()
        for viewer in viewers:
            viewer.join(10)
    assert not failures
    assert min(looks) > 5
