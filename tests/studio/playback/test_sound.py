"""The frames follow the sound, as the device plays it."""

import numpy as np
import pytest

from studio.playback import Player
from studio.playback.clock import Clock
from studio.playback.sound_player import SoundPlayer
from studio.stream import BakeSettings
from tests.support.sounds import ArrayPcm, FakeOutput, clicks
from tests.support.streams import bake_numbered
from tests.support.waiting import wait_until

FPS = 25
FRAMES = 10
SECONDS = FRAMES / FPS
RAMP = np.linspace(0, 0.5, round(SECONDS * 48_000), dtype=np.float32)[:, None]
"""A sound whose value tells the time."""


@pytest.fixture
def output():
    return FakeOutput()


@pytest.fixture
def sound(output):
    player = SoundPlayer(ArrayPcm(RAMP), SECONDS, output)
    yield player
    player.close()
    assert output.fill is None


def heard(output, sound, seconds):
    """Play some time once that much is decoded."""
    wait_until("decoded", lambda: sound.buffered >= seconds)
    return output.pull(seconds)


def test_it_plays_from_where_it_should_and_tells_what_is_heard(output, sound):
    output.latency = 480
    sound.play(0.2, loop=False)
    assert sound.position() == pytest.approx(0.2)
    first = heard(output, sound, 0.05)
    assert first[0, 0] == pytest.approx(0.25, abs=1e-3)
    assert sound.position() == pytest.approx(0.24)  # the device holds 10 ms that are not heard yet
    heard(output, sound, 0.05)
    assert sound.position() == pytest.approx(0.29)
    sound.stop()
    assert sound.position() is None
    assert not output.pull(0.02).any()
    sound.play(0.0, loop=False)
    assert sound.position() == 0
    assert heard(output, sound, 0.02)[0, 0] == pytest.approx(0, abs=1e-3)


def test_loops_have_no_gap(output, sound):
    sound.play(0.3, loop=True)
    samples = heard(output, sound, 0.25)[:, 0]
    wrapped = np.concatenate([RAMP[14_400:, 0], RAMP[: 12_000 - 4800, 0]])
    assert np.allclose(samples, wrapped, atol=1e-4)
    assert sound.position() == pytest.approx(0.55)
    sound.play(0.55, loop=True)  # in the second loop
    assert heard(output, sound, 0.01)[0, 0] == pytest.approx(RAMP[7200, 0], abs=1e-3)


def test_volume_and_mute(output, sound):
    sound.volume = 0.5
    sound.play(0.2, loop=False)
    assert heard(output, sound, 0.02)[0, 0] == pytest.approx(0.125, abs=1e-3)
    sound.muted = True
    assert not heard(output, sound, 0.02).any()
    assert sound.position() == pytest.approx(0.24)  # it still leads


def test_a_missing_or_lost_device_leaves_the_frames_to_the_clock(output):
    for broken in ("missing", "lost"):
        output.refuse = broken == "missing"
        player = SoundPlayer(ArrayPcm(RAMP), SECONDS, output)
        time = [0.0]
        clock = Clock(FPS, FRAMES, True, 1.0, lambda time=time: time[0], leader=player)
        clock.frame_is_ready(0)
        clock.playing = True
        if broken == "lost":
            heard(output, player, 0.08)
            assert clock.due() == 2
            output.time += 5  # and no further request
        wait_until("given up", lambda player=player: player.position() is None)
        assert player.message
        first = clock.due()
        time[0] += 3 / FPS
        assert clock.due() == first + 3
        player.close()


@pytest.fixture(scope="module")
def stream(tmp_path_factory):
    settings = BakeSettings(profile="planes", quality=0)
    folder = tmp_path_factory.mktemp("sounding") / "stream"
    return bake_numbered(folder, (6, 4), FPS, settings=settings, sound=clicks(SECONDS, [0.2]))


def shown(player):
    played = player.frame()
    return None if played is None else played.frame


def test_the_frame_shown_follows_the_device(stream, output, clock, until):
    with Player(stream, now=clock, output=output) as player:
        until(lambda: shown(player) == 0)
        player.play()
        clock.forward(5)  # the wall clock says nothing
        assert shown(player) == 0
        for frame in range(1, 4):
            heard(output, player.sound, 1 / FPS)
            until(lambda frame=frame: shown(player) == frame, f"frame {frame}")
        player.pause()
        output.pull(1 / FPS)
        assert shown(player) == 3
        player.seek(7)
        until(lambda: shown(player) == 7)
        player.play()
        heard(output, player.sound, 1.5 / FPS)
        until(lambda: shown(player) == 8)
        player.set_rate(2.0)  # silent; the clock leads
        assert not output.pull(0.01).any()
        clock.forward(1)  # 20 ms
        until(lambda: shown(player) == 9)
        player.set_rate(1.0)
        heard(output, player.sound, 0.5 / FPS)
        until(lambda: player.finished)


def test_streams_without_sound_play_by_the_clock(long_stream, output, clock, until):
    with Player(long_stream, now=clock, output=output) as player:
        assert player.sound is None
        player.play()
        until(lambda: shown(player) == 0)
        clock.forward(2)
        until(lambda: shown(player) == 2)
