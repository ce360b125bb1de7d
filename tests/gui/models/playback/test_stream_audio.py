import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.support.sounds import FakeOutput, click_times, clicks
from tests.support.streams import bake_numbered, set_capture
from tests.support.waiting import wait_until
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import load
from v3studio.pipelines.takes.take import Take
from v3studio.studio.stream import BakeSettings, CapturePlace

FPS, FRAMES = 25, 10


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten frames with a click in frame 5."""
    settings = BakeSettings(quality=0)
    folder = tmp_path_factory.mktemp("sounding") / "stream"
    return bake_numbered(folder, (6, 4), FPS, settings=settings, sound=clicks(FRAMES / FPS, [5.2 / FPS]))


class Device(FakeOutput):
    """Plays some frames once they are decoded."""

    def frames(self, player: PlayerPresenter, count: float) -> None:
        sound = player.audio.player if player.audio is not None else None
        wait_until("decoded", lambda: sound.queued >= count / FPS * 48_000)
        self.pull(count / FPS)


@pytest.fixture
def device() -> Device:
    return Device()


@pytest.fixture
def player(stream: Path, device: Device) -> Iterator[PlayerPresenter]:
    player = playing(stream, device)
    yield player
    player.close()


def playing(place: Path, device: Device) -> PlayerPresenter:
    picture = np.zeros((8, 8, 3), np.uint8)
    player = PlayerPresenter(lambda gaussians, camera, color: picture, lambda: 0.0, lambda: device)
    player.adopt(*load(place))
    wait_until("loaded", lambda: player.audio is not None and player.audio.waveform is not None)
    player.poll()
    return player


def test_the_transport_follows_the_sound(player: PlayerPresenter, device: Device) -> None:
    transport = player.transport
    transport.play()
    for frame in (1, 2):
        device.frames(player, 1)
        assert transport.frame == frame
    transport.pause()
    assert not device.pull(0.01).any()
    assert transport.frame == 2
    transport.seek(8)
    transport.play()
    device.frames(player, 3)
    assert transport.frame == 1, "looped"
    transport.set_loop(False)
    device.frames(player, 9)
    assert transport.frame == FRAMES - 1
    assert not transport.playing


def test_sound_is_turned_off_and_a_missing_device_told(stream: Path, player: PlayerPresenter, device: Device) -> None:
    player.toggle_sound()
    player.transport.play()
    device.frames(player, 1)
    assert not device.played[-1].any()
    player.toggle_sound()
    device.frames(player, 1)
    assert device.played[-1].any()
    device.refuse = True
    player.adopt(*load(stream))
    wait_until("loaded", lambda: player.audio is not None and player.audio.player is not None)
    player.poll()
    player.transport.play()
    wait_until("told", lambda: player.audio is not None and player.audio.message != "")
    assert player.transport.playing


def test_the_sound_of_a_take_begins_at_its_in_point(stream: Path, device: Device, tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    shutil.copytree(stream, take.stream)
    set_capture(take.stream, CapturePlace(first_frame=3))
    player = playing(take.root, device)
    try:
        loud = np.abs(player.audio.waveform.peaks).max(axis=1)
        assert int(loud.argmax() / len(loud) * (3 + FRAMES)) == 8, "frame 5 of the stream"
        player.transport.seek(7)
        player.transport.play()
        device.frames(player, 2)
        assert player.transport.frame == 9
        assert click_times(device.played[-1]) == pytest.approx([1.2 / FPS], abs=0.005)
        player.transport.seek(1)
        device.frames(player, 2)
        assert not device.played[-1].any(), "before the in point"
        player.transport.seek(12)
        device.frames(player, 2)
        assert player.transport.frame == 1, "looped after the last frame"
    finally:
        player.close()
