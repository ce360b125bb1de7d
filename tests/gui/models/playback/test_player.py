import shutil
import threading
import weakref
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.looping import heard
from tests.support.players import settle
from tests.support.rigs import camera_at
from tests.support.splats import round_splats, write_group
from tests.support.waiting import wait_until
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import load
from v3studio.gui.models.playback.stream_source import StreamSource
from v3studio.gui.models.worker import LatestWorker
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, write_frame
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.gaussians import Gaussians


def flat(gaussians: Gaussians, camera: Camera, background: tuple[float, float, float]) -> np.ndarray:
    """A substitute for rendering: the background, with the position of the first splat in one pixel."""
    image = np.empty((camera.height, camera.width, 3), np.uint8)
    image[:] = np.round(np.array(background) * 255)
    image[0, 0, 0] = int(gaussians.means[0, 0].item() * 100) % 256
    return image


@pytest.fixture
def player() -> Iterator[PlayerPresenter]:
    presenter = PlayerPresenter(flat)
    yield presenter
    assert presenter.close()


def test_nothing_whole_is_a_sentence(stream_folder: Path, tmp_path: Path) -> None:
    shutil.copytree(stream_folder, tmp_path / "gone")
    source = StreamSource(tmp_path / "gone")
    shutil.rmtree(tmp_path / "gone" / "files")
    with refuses("playback.group_skipped", group=1):
        source.gaussians(8)
    with refuses("playback.nothing_playable"):
        source.gaussians(0)
    source.close()
    with refuses("playback.nothing_playable") as caught:
        load(tmp_path / "gone")
    assert "files/" in str(caught.value)


def make_take(root: Path, frames: int, stream: Path | None = None) -> Take:
    """A take as written by the stages: trained frames in groups of 8, a rig, optionally a stream."""
    take = Take.create(root)
    generator = torch.Generator().manual_seed(1)
    for index in range(frames):
        splats = round_splats(torch.rand(50, 3, generator=generator) + index, -4.6, 0.9)
        write_frame(take.finished_frame(index // 8, index), splats, FrameMetadata())
        first = index - index % 8
        write_group(take, index // 8, range(first, min(first + 8, frames)))
    camera = camera_at("front", (0, -4, 0.9), (0, 0, 0.9), focal=500, size=(640, 360))
    take.rig.parent.mkdir(exist_ok=True)
    write_rig(Rig((camera,)), take.rig)
    if stream is not None:
        shutil.copytree(stream, take.stream)
    return take


def test_a_take_shows_decoded_and_trained(player: PlayerPresenter, stream_folder: Path, tmp_path: Path) -> None:
    take = make_take(tmp_path / "take", 12, stream_folder)
    player.adopt(*load(take.root))
    assert list(player.sources) == ["decoded", "trained"]
    view = player.view()
    pixels, depth = view.project(player.points)
    seen = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1)
    assert seen.mean() > 0.9, "everybody, though the rig's first camera is too near for that"
    player.transport.seek(9)
    assert player.choose("trained")
    settle(player)
    assert (player.picture.request.what, player.picture.request.frame, player.picture.splats) == ("trained", 9, 50)
    assert player.transport.group_starts == (0, 8)
    refused = heard(player.refused)
    assert not player.choose("footage")  # no footage is known
    assert "footage" in str(refused)
    assert player.message == "", "what is shown is not at fault"


def test_frames_that_are_trained_meanwhile_show_up(player: PlayerPresenter, tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    player.adopt(*load(take.root))
    assert "Nothing trained" in player.message
    assert not player.refresh()
    make_take(take.root, 3)
    assert player.refresh()
    assert (player.what, player.transport.frame_count) == ("trained", 3)
    settle(player)
    assert player.picture is not None
    player.transport.seek(2)
    make_take(take.root, 9)
    assert player.refresh()
    assert (player.transport.frame_count, player.transport.frame, player.transport.group_starts) == (9, 2, (0, 8))
    settle(player)
    assert player.picture.request.frame == 2


def test_worker_drops_what_is_overtaken_and_reports_errors() -> None:
    started: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def work(number: int) -> int:
        started.append(number)
        begun.set()
        assert go_on.wait(60)
        if number == 7:
            raise ValueError("seven")
        return number * 10

    worker: LatestWorker[int, int] = LatestWorker(work, "test")
    for number in range(8):
        worker.ask(number)
        assert begun.wait(60)
    go_on.set()
    wait_until("idle", lambda: worker.idle)
    assert started == [0, 7]
    done = worker.take()
    assert isinstance(done.error, ValueError)
    assert worker.take() is None


def test_a_worker_does_not_keep_what_is_done() -> None:
    worker: LatestWorker[np.ndarray, int] = LatestWorker(len, "test")
    request = np.zeros(1)
    kept = weakref.ref(request)
    worker.ask(request)
    del request
    wait_until("idle", lambda: worker.idle)
    worker.take()
    wait_until("let go", lambda: kept() is None)
