"""The chart of the QP trial: where its table's words stand and what they say."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gui.drawing.canvas import Canvas
from gui.pages.bake.qp_chart import QpChart
from gui.pages.bake.qp_trial import QpTrial, Trial

TRIAL = SimpleNamespace(
    results={20: Trial(40_000.0, 31.5), 24: Trial(30_000.0, 30.25)}, running=False, words="Two QPs", fps=25.0
)


def drawn(monkeypatch: pytest.MonkeyPatch, width: int) -> tuple[QpChart, list[tuple[str, float, float]]]:
    """A chart, and its words with the place that each is aligned to."""
    texts: list[tuple[str, float, float]] = []
    plain = Canvas.text

    def text(self: Canvas, x: float, y: float, words: str, *rest: Any, **options: Any) -> Any:
        texts.append((words, x, y))
        return plain(self, x, y, words, *rest, **options)

    monkeypatch.setattr(Canvas, "text", text)
    return QpChart((width, 500), 14.0, cast("QpTrial", TRIAL), 24, ""), texts


@pytest.mark.parametrize("width", [1000, 560])  # the table beside the curve, and above it
def test_numbers_stand_below_their_heads_within_the_picture(monkeypatch: pytest.MonkeyPatch, width: int) -> None:
    chart, texts = drawn(monkeypatch, width)
    heads = ("QP", "KB per frame", "Mbit/s", "PSNR, dB")
    first = next(number for number, (words, *_) in enumerate(texts) if words == "QP")
    columns = [x for words, x, _ in texts[first : first + 4]]
    assert [words for words, *_ in texts[first : first + 4]] == list(heads)
    assert all(right - left >= 4 * 14 for left, right in itertools.pairwise(columns))
    assert columns[0] > 0
    assert columns[-1] <= width
    row = {x: words for words, x, y in texts if x in columns and y == next(v for w, _, v in texts if w == "24")}
    assert [row[x] for x in columns] == ["24", "30.0", "6.00", "30.25"]  # 30 kB x 25 x 8 = 6 Mbit/s
    (left, low), (right, high) = chart.points[24], chart.points[20]
    assert left < right  # more bytes
    assert high < low  # better: further up
