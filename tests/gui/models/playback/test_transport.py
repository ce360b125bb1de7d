from tests.support.waiting import HandClock
from v3studio.gui.models.playback.transport import Transport


def test_without_loop_it_ends_at_the_last_frame_and_starts_again(clock: HandClock) -> None:
    transport = Transport(10, 10.0, now=clock)
    transport.set_loop(False)
    transport.play()
    clock.time += 0.95
    assert (transport.frame, transport.playing) == (9, True)
    clock.time += 0.1
    assert (transport.frame, transport.playing) == (9, False)
    transport.play()
    assert (transport.frame, transport.playing) == (0, True)


def test_seek_step_speed_and_loop_keep_the_place(clock: HandClock) -> None:
    transport = Transport(100, 10.0, now=clock)
    transport.play()
    transport.seek(40)
    clock.time += 0.5
    assert transport.frame == 45
    transport.speed = 2.0
    assert transport.frame == 45
    clock.time += 0.5
    assert transport.frame == 55
    transport.set_loop(False)
    assert transport.frame == 55
    transport.step(-1)
    assert (transport.frame, transport.playing) == (54, False)
    transport.step(-1000)
    assert transport.frame == 0
    transport.seek(1000)
    assert transport.frame == 99


def test_group_jumps(clock: HandClock) -> None:
    transport = Transport(30, 25.0, (0, 20), now=clock)
    seen = []
    for direction in (1, 1, -1, -1, -1):
        transport.jump_group(direction)
        seen.append(transport.frame)
    assert seen == [20, 29, 20, 0, 0]


def test_playback_repeats_the_span(clock: HandClock) -> None:
    transport = Transport(20, 10.0, now=clock)
    transport.select_span(8, 5)
    assert transport.span == (5, 8)
    transport.play()
    seen = []
    for step in range(10):
        clock.time = step / 10
        seen.append(transport.frame)
    assert seen == [5, 6, 7, 8, 5, 6, 7, 8, 5, 6], "it begins at the span"
    assert transport.clear_span()
    assert transport.frame == 6, "the frame is kept"
    clock.time += 0.5
    assert transport.frame == 11
    assert not transport.clear_span()


def test_a_key_sets_begin_and_end_and_clears() -> None:
    transport = Transport(20, 10.0, now=HandClock())
    transport.seek(12)
    assert "begins at frame 12" in transport.step_span()
    assert transport.span is None
    transport.seek(3)
    assert "3 to 12" in transport.step_span()
    assert transport.span == (3, 12)
    transport.step_span()
    assert transport.span is None
    transport.select_span(0, 99)
    assert transport.span == (0, 19)
    transport.resize(10, (0,), 10.0)
    assert transport.span is None, "its frames are gone"
