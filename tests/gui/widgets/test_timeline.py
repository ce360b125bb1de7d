"""The timeline's wheel: it zooms, unless it scrolls what lies over the timeline."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from open3d.visualization import gui

from gui.models.playback.player import PlayerPresenter
from gui.models.playback.timeline_zoom import TimelineZoom
from gui.widgets import timeline
from gui.widgets.timeline import TimelinePanel


class Picture:
    """Takes the place of the toolkit's widget, which needs a window."""

    size = (800, 160)

    def __init__(self, on_mouse) -> None:
        self.on_mouse = on_mouse
        self.widget = SimpleNamespace(frame=gui.Rect(0, 0, 800, 160), tooltip="")


@pytest.mark.parametrize("covered", [False, True])
def test_the_wheel_over_an_open_list_does_not_zoom(monkeypatch: pytest.MonkeyPatch, covered: bool) -> None:
    monkeypatch.setattr(timeline, "ImagePanel", Picture)
    player = PlayerPresenter()
    panel = TimelinePanel(player, 16.0, lambda: None)
    player.transport.resize(100, (0,), 25.0)
    panel.look((500, 80), covered)
    wheel = SimpleNamespace(type=gui.MouseEvent.Type.WHEEL, wheel_dy=3)
    assert panel.picture.on_mouse(wheel, 500.0, 80.0)  # type: ignore[attr-defined]
    assert (panel.zoom == TimelineZoom()) is covered
    panel.filmstrip.close()
    player.close()
