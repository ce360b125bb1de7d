"""Groups are initialized side by side, with one progress."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from pipelines.stages.initialize import _SharedProgress
from studio.errors import Cancelled


def test_progress_is_that_of_all_groups() -> None:
    seen: list[tuple[float, str]] = []
    reporter = SimpleNamespace(progress=lambda fraction, label: seen.append((round(fraction, 3), label)))
    shared = _SharedProgress(cast(Any, reporter), 0.2, 2)
    first, second = shared.of(0), shared.of(3)
    second(50, 100)
    first(100, 100)
    second(100, 100)
    assert seen == [(0.4, "group 3: visual hull"), (0.8, "group 0: visual hull"), (1.0, "group 3: visual hull")]
    shared.stop.cancel()
    with pytest.raises(Cancelled):
        first(100, 100)
