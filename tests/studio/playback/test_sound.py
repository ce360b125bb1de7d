"""The sound of a stream, as the device plays it."""

from collections.abc import Iterator

import numpy as np
import pytest

from tests.support.sounds import ArrayPcm, FakeOutput
from tests.support.waiting import wait_until
from v3studio.studio.playback.sound_player import SoundPlayer

SECONDS = 0.4
RAMP = np.linspace(0, 0.5, round(SECONDS * 48_000), dtype=np.float32)[:, None]
"""A sound whose value tells the time."""


@pytest.fixture
def output() -> FakeOutput:
    return FakeOutput()


@pytest.fixture
def sound(output: FakeOutput) -> Iterator[SoundPlayer]:
    player = SoundPlayer(ArrayPcm(RAMP), SECONDS, output)
    yield player
    player.close()
    assert output.fill is None


def heard(output, sound, seconds):
    """Play some time once that much is decoded."""
    wait_until("decoded", lambda: sound.queued >= seconds * 48_000)
    return output.pull(seconds)


def test_it_plays_from_where_it_should_and_tells_what_is_heard(output: FakeOutput, sound: SoundPlayer) -> None:
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


def test_loops_have_no_gap(output: FakeOutput, sound: SoundPlayer) -> None:
    sound.play(0.3, loop=True)
    samples = heard(output, sound, 0.25)[:, 0]
    wrapped = np.concatenate([RAMP[14_400:, 0], RAMP[: 12_000 - 4800, 0]])
    assert np.allclose(samples, wrapped, atol=1e-4)
    assert sound.position() == pytest.approx(0.55)
    sound.play(0.55, loop=True)  # in the second loop
    assert heard(output, sound, 0.01)[0, 0] == pytest.approx(RAMP[7200, 0], abs=1e-3)


def test_volume(output: FakeOutput, sound: SoundPlayer) -> None:
    sound.volume = 0.5
    sound.play(0.2, loop=False)
    assert heard(output, sound, 0.02)[0, 0] == pytest.approx(0.125, abs=1e-3)
    sound.volume = 0.0
    assert not heard(output, sound, 0.02).any()
    assert sound.position() == pytest.approx(0.24)  # it still leads


@pytest.mark.parametrize("broken", ["missing", "lost"])
def test_a_missing_or_lost_device_is_silent_and_says_why(output: FakeOutput, broken: str) -> None:
    output.refuse = broken == "missing"
    player = SoundPlayer(ArrayPcm(RAMP), SECONDS, output)
    player.play(0.0, loop=False)
    if broken == "lost":
        heard(output, player, 0.08)
        assert player.position() == pytest.approx(0.08)
        output.time += 5  # and no further request
    wait_until("given up", lambda: player.position() is None)
    assert player.message
    player.close()
