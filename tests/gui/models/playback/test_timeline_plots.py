"""The plots above the timeline: what bars and lines are in proportion to, and the values under the pointer."""

import numpy as np
import pytest

from gui.drawing.palette import BAD, FAIR, PANEL, RAISED, TEXT
from gui.models.playback.timeline_plots import LEAST_SPAN, PLOTTED, RULER, TimelinePlots, plots_of
from gui.models.playback.timeline_zoom import LEAST_FRAMES, TimelineZoom

VIEW = TimelinePlots(900, 160, 16.0, 4)


def test_bars_of_sizes_begin_at_zero() -> None:
    psnr, size = plots_of({"bytes": [46_800, 44_700, None, 23_400], "psnr_decoded": [30.0, 30.1, None, 30.2]})
    assert size.extremes == (0, 46.8)
    assert size.range[0] == 0
    picture = VIEW.base([size])
    heights = []
    for frame in (0, 1, 3):
        column = VIEW.left + sum(VIEW.timeline.span(frame)) // 2 - 30
        row = picture[: 160 - VIEW.track_height, column]
        heights.append(int(((row != RAISED) & (row != PANEL)).any(axis=1).sum()))
    assert abs(heights[1] / heights[0] - 44.7 / 46.8) < 0.03
    assert abs(heights[2] / heights[0] - 0.5) < 0.03
    assert psnr.extremes == (30.0, 30.2), "the padding of the axis is not written beside it"
    assert psnr.range[1] - psnr.range[0] >= LEAST_SPAN, "a tenth of a decibel does not fill the row"
    assert psnr.range[0] < 30.0 < 30.2 < psnr.range[1]


@pytest.mark.parametrize(
    ("count", "first", "shown"), [(4, 0.0, None), (300, 0.0, None), (90_000, 0.0, None), (300, 117.4, 30.0)]
)
def test_numbered_frames_are_apart_and_above_their_frames(count: int, first: float, shown: float | None) -> None:
    view = TimelinePlots(900, 160, 16.0, count, (0,), first, shown)
    numbered = view.numbered
    assert 3 <= len(numbered) <= 16
    steps = set(np.diff(numbered))
    assert len(steps) == 1
    assert str(steps.pop()).strip("0") in ("1", "2", "5")
    assert all(view.timeline.shows(frame) for frame in numbered)
    row = slice(160 - view.track_height - round(RULER * 16.0), 160 - view.track_height)
    words = (view.base(())[row, : view.left + view.timeline.width] != PANEL).any(axis=2)
    columns = np.flatnonzero(words[:, view.left :].any(axis=0)) + view.left
    runs = np.split(columns, np.flatnonzero(np.diff(columns) > 12) + 1)
    assert [view.frame_at(run.mean()) // 1 for run in runs] == pytest.approx(numbered, abs=max(count * 0.03, 1))


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


def test_only_what_was_measured_has_a_row() -> None:
    assert len(plots_of({"psnr_trained": [30.0, 31.0], "flicker": [None, None]})) == 1
    *_, flicker = plots_of({"psnr_trained": [30.0, 31.0], "flicker": [None, 1.5]})
    stale = plots_of({name: [1.0, 2.0] for name in PLOTTED}, "mean, earlier bake", of=", earlier bake")
    assert all(plot.title.endswith(", earlier bake") for plot in stale), "no row passes for one of the bake on screen"
    assert flicker.values == [None, 1.5]
    assert flicker.range == (0, 1.5 * 1.05)


def test_views_of_the_camera_path_are_found_where_they_are_drawn() -> None:
    keys = (0, 2, 3)
    base = VIEW.base((), (), keys)
    shown = VIEW.with_head(base, 1, ())
    rows, columns = np.nonzero((shown == FAIR).all(axis=2))
    assert {VIEW.key_at(x, y, keys) for x, y in zip(columns, rows, strict=True)} == {0, 1, 2}
    assert {VIEW.frame_at(x) for x in columns} == set(keys)
    assert VIEW.key_at(VIEW.left + 5, 20, keys) is None


def test_zoom_keeps_what_is_under_the_pointer() -> None:
    zoom, frames = TimelineZoom(), 300
    for _ in range(30):
        zoom = zoom.zoomed(1, 0.25, frames)
        assert zoom.shown is not None
        assert zoom.first + 0.25 * zoom.shown == pytest.approx(75)
    assert zoom.shown == LEAST_FRAMES
    assert zoom.moved(1e6, frames).first == 295
    assert zoom.moved(-1e6, frames).first == 0
    assert zoom.following(75, frames) == zoom
    assert zoom.following(200, frames).first == 200
    assert zoom.zoomed(-99, 0.5, frames) == TimelineZoom()
    assert zoom.within(4) == TimelineZoom(), "what is open now has fewer frames"


@pytest.mark.parametrize("first", [0.0, 7.3, 15.0])
def test_a_zoomed_timeline_shows_its_part(first: float) -> None:
    view = TimelinePlots(900, 160, 16.0, 20, (0, 10), first, 5.0)
    timeline = view.timeline
    seen = [timeline.frame_at(x) for x in range(timeline.width)]
    for frame in range(20):
        columns = [x for x, other in enumerate(seen) if other == frame]
        left, right = timeline.span(frame)
        assert (bool(columns), timeline.shows(frame)) == (right > left, right > left)
        if columns:
            assert (left, right) == pytest.approx((columns[0], columns[-1] + 1), abs=1)
    plots = plots_of({"psnr_decoded": [20.0 + frame for frame in range(20)], "bytes": [1000.0] * 20})
    inside, outside = round(first) + 2, (round(first) + 10) % 20
    base = view.base(plots, (inside, outside), (inside, outside))
    shown = view.with_head(base, inside, plots)
    (marked,) = {view.frame_at(x) for x in np.nonzero((shown == BAD).all(axis=2))[1]}
    (moved,) = {view.frame_at(x) for x in np.nonzero((shown == FAIR).all(axis=2))[1]}
    assert (marked, moved) == (inside, inside)
    assert view.with_head(base, outside, plots).shape == (160, 900, 3)
