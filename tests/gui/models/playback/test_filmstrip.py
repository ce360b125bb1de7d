"""The strip of pictures shows frames where the timeline has them, and keeps them when it is panned or zoomed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from open3d.visualization import gui
from starlette.applications import Starlette
from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

from gui.drawing.palette import FAIR, RAISED
from gui.models.playback.filmstrip import Filmstrip, draw_strip, slots
from gui.models.playback.player import PlayerPresenter
from gui.models.playback.thumbnails import Thumbnails
from gui.models.playback.timeline import Timeline
from gui.models.playback.timeline_plots import TimelinePlots
from gui.widgets.timeline import TimelinePanel
from studio.cameras import Camera
from tests.support.players import settle
from tests.support.waiting import wait_until
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


def test_a_picture_is_drawn_at_its_place() -> None:
    color = (200, 10, 10)
    strip = draw_strip(ALL, (40, 30), {8: np.full((30, 40, 3), color, np.uint8), 16: None})
    assert strip.shape == (30, 600, 3)
    columns = np.flatnonzero((strip == color).all(axis=(0, 2)))
    assert (columns.min(), columns.max()) == (48, 94), "its ground fills its place but for a line"
    assert (strip[:, 95:] == RAISED).all()


def test_a_narrow_picture_is_in_the_middle_of_its_place() -> None:
    picture = np.zeros((30, 40, 3), np.uint8)
    picture[:, 20] = 255
    strip = draw_strip(Timeline(800, 20, 8), (40, 30), {1: picture})
    assert np.flatnonzero((strip == 255).all(axis=(0, 2))).tolist() == [150]


def test_the_selected_span_is_marked_where_it_is() -> None:
    view = TimelinePlots(900, 160, 16.0, 40, strip=40, span=(10, 19))
    picture = view.base([])
    columns = np.flatnonzero((picture[1] == FAIR).all(axis=1))
    assert view.frame_at(columns.min()) == 10
    assert view.frame_at(columns.max()) == 19
    assert view.in_strip(20)
    assert not view.in_strip(60)
    assert all(top >= 40 for top, _ in view._rows(4)), "the rows are below the pictures"


def picture_of(thumbnails: Thumbnails, place: Path, contents: object, ask: bool = True) -> np.ndarray | None:
    camera = Camera("view", 64, 48, np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]), np.eye(4))
    return thumbnails.get(place, contents, camera, 0, (64, 48), ask)


def test_a_picture_stays_until_that_of_the_new_contents_is_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn: list[object] = []

    def draw(self: Thumbnails, request: Any) -> np.ndarray:
        drawn.append(request.contents)
        return np.full((48, 64, 3), len(drawn), np.uint8)

    monkeypatch.setattr(Thumbnails, "_draw", draw)
    thumbnails = Thumbnails()
    assert picture_of(thumbnails, tmp_path, "one frame") is None
    wait_until("a picture", thumbnails.poll)
    first = picture_of(thumbnails, tmp_path, "one frame")
    assert first is not None
    assert picture_of(thumbnails, tmp_path, "two frames", ask=False) is first
    assert drawn == ["one frame"], "none is drawn while a stage runs"
    assert picture_of(thumbnails, tmp_path, "two frames") is first
    wait_until("the next picture", thumbnails.poll)
    second = picture_of(thumbnails, tmp_path, "two frames")
    assert second is not None
    assert second[0, 0, 0] == 2
    assert picture_of(thumbnails, tmp_path, "two frames") is second
    assert drawn == ["one frame", "two frames"], "and not again"
    assert thumbnails.close()


@pytest.fixture
def player() -> Iterator[PlayerPresenter]:
    found = PlayerPresenter()
    yield found
    assert found.close()


def test_none_is_asked_for_while_a_stage_runs(
    monkeypatch: pytest.MonkeyPatch, player: PlayerPresenter, stream_folder: Path
) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(Thumbnails, "get", lambda *arguments: asked.append(arguments[-1]))
    assert player.open(stream_folder)
    player.transport.pause()
    strip = Filmstrip()
    for busy in (False, True):
        assert set(strip.pictures(player, [0, 4], (40, 50), busy)) == {0, 4}
    assert asked == [True, True, False, False]
    assert strip.close()


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


def test_a_drag_whose_release_was_lost_selects_nothing_more(player: PlayerPresenter, stream_folder: Path) -> None:
    assert player.open(stream_folder)
    panel, view = TimelinePanel(player, 16.0, lambda: None), TimelinePlots(900, 160, 16.0, 12, strip=40)
    kind = gui.MouseEvent.Type

    def send(type_: Any, frame: int, y: float) -> bool:
        event = SimpleNamespace(type=type_, is_button_down=lambda button: True, is_modifier_down=lambda key: False)
        return panel._select(cast(gui.MouseEvent, event), view, view.left + sum(view.timeline.span(frame)) / 2, y)

    assert send(kind.BUTTON_DOWN, 2, 20)
    assert send(kind.DRAG, 5, 20)
    assert player.transport.span == (2, 5)
    assert not send(kind.BUTTON_DOWN, 8, 150), "below the pictures: a seek"
    assert not send(kind.DRAG, 9, 150)
    assert player.transport.span == (2, 5)
    assert panel.filmstrip.close()
