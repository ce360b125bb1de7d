"""Statistics of playback against Python's own `statistics` module."""

from __future__ import annotations

import random
import statistics

import pytest

from studio.playback.statistics import FrameStats, PlaybackReport, Spread


@pytest.mark.parametrize("count", [2, 3, 20, 100, 101])
def test_spread_is_what_the_standard_library_computes(count: int) -> None:
    values = [random.Random(count).gammavariate(2, 5) for _ in range(count)]
    found = Spread.of(values)
    assert found.mean == pytest.approx(statistics.fmean(values))
    assert found.median == pytest.approx(statistics.median(values))
    assert found.p95 == pytest.approx(statistics.quantiles(values, n=20, method="inclusive")[18])
    assert found.max == max(values)


def test_spread_of_one_value_and_of_none() -> None:
    assert Spread.of([7.0]) == Spread(7.0, 7.0, 7.0, 7.0)
    assert Spread.of([]) == Spread(0.0, 0.0, 0.0, 0.0)


def test_frames_that_were_not_rendered_do_not_count() -> None:
    frames = [FrameStats(i, 0, 100.0 * i, 1, 2, 3, render_ms=None if i == 2 else float(i)) for i in range(4)]
    report = PlaybackReport(tuple(frames), dropped=1, seconds=2.0)
    assert report.spread("render_ms") == Spread.of([0.0, 1.0, 3.0])
    assert report.spread("bytes").median == 150.0
    assert report.fps == 2.0
    assert "render_ms" in report.to_dict()["summary"]  # type: ignore[operator]
    assert PlaybackReport((), 0, 0.0).fps == 0.0
