"""The figures that the memory of the window is judged by."""

from __future__ import annotations

import gc
import importlib.util
from pathlib import Path

import pytest

from studio.errors import StudioError

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("window_memory", ROOT / "benchmarks" / "window_memory.py")
assert spec is not None
assert spec.loader is not None
script = importlib.util.module_from_spec(spec)
spec.loader.exec_module(script)


def test_growth_is_that_of_the_later_rounds() -> None:
    warming = [100.0, 900.0, 1500.0]
    assert script.growth([*warming, *[2000.0] * 9]) == pytest.approx(0, abs=1e-9)
    assert script.growth([*warming, *[2000.0 + 7.5 * at for at in range(9)]]) == pytest.approx(7.5)
    assert script.growth([0.0, 3.0, 1.0, 4.0]) == pytest.approx(0.5)  # of the last three
    with pytest.raises(StudioError, match="too few"):
        script.growth([1.0, 2.0])


def test_what_malloc_has_in_use_is_counted_in_all_sizes() -> None:
    gc.collect()  # or garbage of other tests may go meanwhile
    used, _ = script.allocated()
    large = bytearray(50 << 20)
    small = [bytes(1000) for _ in range(40_000)]
    with_both, _ = script.allocated()
    assert with_both - used == pytest.approx(50 + 40_000 * 1000 / 2**20, rel=0.1)
    del large
    small.clear()
    left, free = script.allocated()
    assert left - used < 5
    assert free > 0


def test_a_round_is_measured() -> None:
    row = script.measure(3, 0.0)
    assert row["round"] == 3
    assert row["resident_mib"] > 20
    assert row["threads"] >= 1
    with (ROOT / "README.md").open():
        assert script.measure(4, 0.0)["files"] == row["files"] + 1


def test_no_time_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["window_memory.py", "take", "--minutes", "0"])
    assert script.main() == 2
    assert capsys.readouterr().err.startswith("window_memory: --minutes 0 leaves no time for a round")
