import numpy as np
import pytest

from v3studio.gui.drawing.palette import BAD, FAIR, TEXT
from v3studio.gui.models.playback.timeline import LEAST_FRAMES, TimelineZoom
from v3studio.gui.models.playback.timeline_plots import TimelinePlots, plots_of

VIEW = TimelinePlots(900, 160, 16.0, 4)


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


def test_zoom_keeps_what_is_under_the_pointer() -> None:
    zoom, frames = TimelineZoom(), 300
    for _ in range(30):
        zoom = zoom.zoomed(1, 0.25, frames)
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
    view = TimelinePlots(900, 160, 16.0, 20, (0, 10), TimelineZoom(first, 5.0))
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
    base = view.base(plots)
    shown = view.with_head(base, inside, plots, (inside, outside), (inside, outside))
    (marked,) = {view.frame_at(x) for x in np.nonzero((shown == BAD).all(axis=2))[1]}
    (moved,) = {view.frame_at(x) for x in np.nonzero((shown == FAIR).all(axis=2))[1]}
    assert (marked, moved) == (inside, inside)
    assert view.with_head(base, outside, plots).shape == (160, 900, 3)
