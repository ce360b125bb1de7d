"""The plots above the timeline: what bars and lines are in proportion to, and the values under the pointer."""

from __future__ import annotations

import numpy as np

from gui.presenters.drawing.palette import FAIR, PANEL, RAISED, TEXT
from gui.presenters.playback.timeline_plots import LEAST_SPAN, TimelinePlots, plots_of

VIEW = TimelinePlots(900, 160, 16.0, 4)


def test_bars_of_sizes_begin_at_zero() -> None:
    _, psnr, size = plots_of({"bytes": [46_800, 44_700, None, 23_400], "psnr_decoded": [30.0, 30.1, None, 30.2]})
    assert size.range is not None
    assert size.range[0] == 0
    picture = VIEW.base([size])
    heights = []
    for frame in (0, 1, 3):
        column = VIEW.left + sum(VIEW.timeline.span(frame)) // 2 - 30
        row = picture[: 160 - VIEW.track_height, column]
        heights.append(int(((row != RAISED) & (row != PANEL)).any(axis=1).sum()))
    assert abs(heights[1] / heights[0] - 44.7 / 46.8) < 0.03
    assert abs(heights[2] / heights[0] - 0.5) < 0.03
    assert psnr.range is not None
    assert psnr.range[1] - psnr.range[0] >= LEAST_SPAN, "a tenth of a decibel does not fill the row"
    assert psnr.range[0] < 30.0 < 30.2 < psnr.range[1]


def test_values_under_the_pointer() -> None:
    plots = plots_of({"psnr_trained": [30.0, 31.0, 32.0, 33.0]})
    base = VIEW.base(plots)
    without, hovered = VIEW.with_head(base, 0, plots), VIEW.with_head(base, 0, plots, hover=2)
    column = VIEW.left + sum(VIEW.timeline.span(2)) // 2
    changed = np.flatnonzero((without != hovered).any(axis=(0, 2)))
    assert column - 1 <= changed.min() <= column
    assert (hovered[10, changed.min()] == TEXT).all(), "the line"
    assert changed.max() > column + 20, "the values beside it"
    assert changed.max() < VIEW.left + VIEW.timeline.span(3)[1]


def test_views_of_the_camera_path_are_found_where_they_are_drawn() -> None:
    keys = (0, 2, 3)
    base = VIEW.base((), (), keys)
    shown = VIEW.with_head(base, 1, ())
    rows, columns = np.nonzero((shown == FAIR).all(axis=2))
    assert {VIEW.key_at(x, y, keys) for x, y in zip(columns, rows, strict=True)} == {0, 1, 2}
    assert {VIEW.frame_at(x) for x in columns} == set(keys)
    assert VIEW.key_at(VIEW.left + 5, 20, keys) is None
