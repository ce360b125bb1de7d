"""The right panel: the figures get the room that they need, as far as the log keeps some lines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from open3d.visualization import gui

from gui.drawing.palette import PANEL
from gui.models.evaluation import Evaluation
from gui.models.marks import Marks
from gui.models.take.inspector import Block, figures_height, figures_picture
from gui.widgets.inspector import LEAST_DRAGGED, LEAST_LOG, InspectorPanel

EM = 16.0


def blocks(rows: int) -> list[Block]:
    return [Block("Frame", [(f"row {number}", str(number)) for number in range(rows)])]


@pytest.mark.parametrize("stage", ["review", "calibrate"])
def test_figures_get_the_room_that_they_need(stage: str) -> None:
    panel = InspectorPanel(EM, lambda: None, lambda fix: None)
    panel.stage = stage
    panel.place(1000, 24, 270, 540)
    before = panel.figures.size[1]
    needed = {}
    for rows in (2, 18, 60):
        panel._blocks = blocks(rows)
        panel._share()
        needed[rows] = figures_height(panel._blocks, 270, EM)
        height, log = panel.figures.size[1], panel.log.widget.frame
        assert log.y == 24 + height, "one below the other"
        assert log.height == 540 - height
        assert height >= min(needed[rows], 540 - LEAST_LOG * EM) - 1
        assert log.height >= LEAST_LOG * EM - 1
        if rows == 2:
            assert height == before, "few figures do not move the log"
    assert needed[18] > 0.5 * 540
    assert needed[60] > 540


def test_the_log_is_drawn_in_the_size_that_figures_leave_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    panel = InspectorPanel(EM, lambda: None, lambda fix: None)
    panel.place(1000, 24, 270, 540)
    drawn = list[tuple[int, ...]]()
    monkeypatch.setattr(panel.log, "show", lambda picture: drawn.append(picture.shape[:2]))
    monkeypatch.setattr("gui.widgets.inspector.run_blocks", lambda workspace, stage: [])
    run = SimpleNamespace(lines=[("", "a line")], times=[1.0], notices=[None])
    workspace: Any = SimpleNamespace(run=run, config=None, take=None)
    player: Any = SimpleNamespace(frame=0, what="trained", mode="single", camera="")
    for rows in (2, 30):
        monkeypatch.setattr("gui.widgets.inspector.review_blocks", lambda *of, rows=rows: blocks(rows))
        player.frame = rows  # another frame is shown at once
        assert panel.update(player, Evaluation(), Marks(None), workspace, "review", (), 0.0, "")
        assert panel.update_log(workspace)
        assert drawn[-1] == (panel.log.widget.frame.height, 270)
    assert drawn[0] != drawn[-1]


PLACES = ((900, 24, 270, 540), (1000, 30, 270, 540), (1000, 24, 300, 540), (1000, 24, 270, 700))


@pytest.mark.parametrize("place", PLACES)
def test_both_parts_follow_the_window(place: tuple[int, int, int, int]) -> None:
    panel = InspectorPanel(EM, lambda: None, lambda fix: None)
    panel._blocks = blocks(20)
    for x, y, width, height in ((1000, 24, 270, 540), place):
        panel.place(x, y, width, height)
        above, log = panel.figures.widget.frame, panel.log.widget.frame
        assert (above.x, above.y, above.width) == (x, y, width)
        assert (log.x, log.y, log.width) == (x, y + above.height, width)
        assert above.height + log.height == height


def mouse(kind: str, y: float) -> gui.MouseEvent:
    event = SimpleNamespace(type=getattr(gui.MouseEvent.Type, kind), wheel_dy=0.0)
    return cast(gui.MouseEvent, event)


def test_the_log_is_resized_by_its_heading_and_enlarged_by_a_click() -> None:
    layouts: list[None] = []
    panel = InspectorPanel(EM, lambda: None, lambda fix: None, lambda: layouts.append(None))
    over = (300, 50, 970, 500)
    panel.place(1000, 24, 270, 540, over)
    before = panel.log.widget.frame.height
    panel._on_mouse(mouse("BUTTON_DOWN", 5), 100, 5)
    panel._on_mouse(mouse("DRAG", -155), 100, -155)
    panel._on_mouse(mouse("BUTTON_UP", 5), 100, 5)
    higher = panel.log.widget.frame.height
    assert higher == pytest.approx(before + 160, abs=EM)
    assert not layouts
    assert panel.figures.size[1] + higher == 540
    panel._on_mouse(mouse("BUTTON_DOWN", 5), 100, 5)
    panel._on_mouse(mouse("DRAG", 9000), 100, 9000)
    panel._on_mouse(mouse("BUTTON_UP", 5), 100, 5)
    assert panel.log.widget.frame.height >= LEAST_DRAGGED * EM - 1, "never out of reach"
    for large in (True, False):
        panel._on_mouse(mouse("BUTTON_DOWN", 5), 100, 5)
        panel._on_mouse(mouse("BUTTON_UP", 5), 100, 5)
        assert panel.large == large
        panel.place(1000, 24, 270, 540, over)
        frame = panel.log.widget.frame
        assert ((frame.x, frame.y, frame.width, frame.height) == over) == large
    assert len(layouts) == 2


def test_more_figures_than_fit_end_with_a_sentence() -> None:
    def bottom(rows: int, down: float = 0.0) -> np.ndarray:
        return figures_picture(blocks(rows), 270, 200, EM, down)[-18:]

    assert (bottom(30) == bottom(31)).all(), "no row is cut in half"
    assert (bottom(30) != PANEL).any()
    assert (bottom(3) == PANEL).all()
    end = figures_height(blocks(30), 270, EM) - 200
    assert (bottom(30, end) != bottom(30)).any(), "the last row, once it is in view"
