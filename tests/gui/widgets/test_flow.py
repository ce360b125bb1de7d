"""Rows of buttons that wrap."""

from __future__ import annotations

from typing import Any

from open3d.visualization import gui

from gui.widgets.flow import Flow, flow_lines


def test_groups_stay_together_where_a_line_can_hold_them() -> None:
    # three groups: 2, 3 and 2 buttons
    lines = flow_lines([50] * 7, [0, 0, 8, 0, 0, 8, 0], 300, 4)
    assert [[at for at, _ in line] for line in lines] == [[0, 1, 2, 3, 4], [5, 6]]
    assert lines[0] == [(0, 0), (1, 54), (2, 116), (3, 170), (4, 224)]
    assert lines[1] == [(5, 0), (6, 54)], "no room before the first of a line"
    lines = flow_lines([50] * 7, [0, 0, 8, 0, 0, 8, 0], 250, 4)
    assert [[at for at, _ in line] for line in lines] == [[0, 1], [2, 3, 4], [5, 6]]


def test_a_group_wider_than_a_line_is_divided() -> None:
    lines = flow_lines([50] * 4, [8, 0, 0, 0], 120, 4)
    assert [[at for at, _ in line] for line in lines] == [[0, 1], [2, 3]]
    assert flow_lines([], [], 100, 4) == [[]]


def test_what_is_at_the_right_stays_there_while_its_first_is_hidden() -> None:
    row, context = Flow(4, 20), Any
    left, hidden, last = (gui.Widget() for _ in range(3))
    row.add(left, width=50)
    row.add(hidden, right=True, width=80)
    row.add(last, width=60)
    row.place(10, 0, 400, context)
    assert (left.frame.x, last.frame.x) == (10, 350)
    hidden.visible = False
    row.place(10, 0, 400, context)
    assert (left.frame.x, last.frame.x) == (10, 350)
