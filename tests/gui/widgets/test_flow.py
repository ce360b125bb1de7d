"""Rows of buttons that wrap."""

from gui.widgets.flow import flow_lines


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
