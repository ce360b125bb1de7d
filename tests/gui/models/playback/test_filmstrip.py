"""The strip of pictures shows frames where the timeline has them, and keeps them when it is panned or zoomed."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from gui.models.playback import thumbnails as thumbnails_module
from gui.models.playback.filmstrip import slots
from gui.models.playback.player import PlayerPresenter
from gui.models.playback.thumbnails import Thumbnails
from gui.models.playback.timeline import Timeline
from gui.widgets.timeline import TimelinePanel
from studio.cameras import Camera
from tests.support.looping import heard, wait_in_loop
from tests.support.players import settle
from tests.support.web_servers import running

ALL = Timeline(600, 20, 100)


@pytest.mark.parametrize("timeline", [ALL, Timeline(600, 20, 100, (0,), 13.0, 30.0), Timeline(600, 20, 4)])
def test_pictures_begin_at_their_frames_and_do_not_overlap(timeline: Timeline) -> None:
    found = slots(timeline, 40)
    assert all(second.x - first.x >= 40 for first, second in itertools.pairwise(found))
    for slot in found:
        if slot.x >= 0:
            assert timeline.frame_at(slot.x + 0.5) == slot.frame
    assert found[0].x <= 0, "no gap at the left"
    assert found[-1].frame < timeline.frame_count


def test_panning_keeps_frames_and_zooming_keeps_half_of_them() -> None:
    frames = {slot.frame for slot in slots(ALL, 40)}
    assert frames == set(range(0, 100, 8))
    panned = {slot.frame for slot in slots(Timeline(600, 20, 100, (0,), 20.0, 50.0), 40)}
    assert {frame for frame in frames if 20 <= frame < 70} <= panned
    assert panned <= set(range(0, 100, 4))


def picture_of(thumbnails: Thumbnails, place: Path, contents: object, ask: bool = True) -> np.ndarray | None:
    camera = Camera("view", 64, 48, np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]), np.eye(4))
    return thumbnails.get(place, contents, camera, 0, (64, 48), ask)


def test_a_picture_stays_until_that_of_the_new_contents_is_there(
    monkeypatch: pytest.MonkeyPatch, stream_folder: Path
) -> None:
    drawn: list[object] = []

    def draw(*_: object) -> np.ndarray:
        drawn.append(len(drawn))
        return np.full((48, 64, 3), len(drawn), np.uint8)

    monkeypatch.setattr(thumbnails_module, "draw", draw)
    thumbnails = Thumbnails()
    changes = heard(thumbnails.changed)
    assert picture_of(thumbnails, stream_folder, "one frame") is None
    wait_in_loop("a picture", lambda: len(changes) == 1)
    first = picture_of(thumbnails, stream_folder, "one frame")
    assert first is not None
    assert picture_of(thumbnails, stream_folder, "two frames", ask=False) is first
    assert len(drawn) == 1, "none is drawn while a stage runs"
    assert picture_of(thumbnails, stream_folder, "two frames") is first
    wait_in_loop("the next picture", lambda: len(changes) == 2)
    second = picture_of(thumbnails, stream_folder, "two frames")
    assert second[0, 0, 0] == 2
    assert picture_of(thumbnails, stream_folder, "two frames") is second
    assert len(drawn) == 2, "and not again"
    assert thumbnails.close()


@pytest.fixture
def player() -> Iterator[PlayerPresenter]:
    found = PlayerPresenter()
    yield found
    assert found.close()


def test_a_stream_on_the_web_is_not_downloaded_for_the_strip(player: PlayerPresenter, stream_folder: Path) -> None:
    asked: list[str] = []

    class Files(StaticFiles):
        async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
            asked.append(scope["path"])
            await super().__call__(scope, receive, send)

    panel = TimelinePanel(player, 16.0, lambda: None)
    with running(Starlette(routes=[Mount("/", Files(directory=stream_folder))])) as port:
        assert player.open(f"http://127.0.0.1:{port}"), player.message
        for frame in (0, 11):  # of both groups
            player.transport.seek(frame)
            settle(player)
        before = len(asked)
        assert before
        assert panel.filmstrip.pictures(player, [0, 4], (40, 50)) == {}
        assert panel.plots_view.strip == 0, "no room for it either"
        assert panel.filmstrip.close()
        assert len(asked) == before
    assert player.open(stream_folder)
    assert panel.plots_view.strip > 0
