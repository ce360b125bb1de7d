"""The benchmark of the stream runs on a take, and its BD-rate is that of curves whose distance is known."""

from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import rate_distortion

    monkeypatch.setattr(rate_distortion, "RELEASED_QPS", (10, 28))
    monkeypatch.setattr(rate_distortion, "OUR_QPS", {"planes": (10, 28), "motion": (10, 28)})
    monkeypatch.setattr(rate_distortion, "SPEED_SPLATS", (500,))
    return rate_distortion


def test_the_tables_of_a_take(finished: Path, script: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert script.main([str(finished / "take"), "--groups", "0"]) == 0
    text = capsys.readouterr().out
    assert "groups: 1, frames: 3" in text
    assert "held-out cameras cam4" in text
    for name in ("released", "planes", "motion"):
        found = [line.split("|") for line in text.splitlines() if line.startswith(f"| {name} |")]
        sizes, psnr = ([float(row[column].split()[0]) for row in found] for column in (3, 5))
        assert len(found) == 2
        assert sizes[0] > sizes[1] > 0
        assert psnr[0] > psnr[1] > 10


def test_bd_rate(script: ModuleType) -> None:
    curve = [script.Point("a", 0, 10.0 * 1.2**step, 30.0 + step, 30.0 + step, 0.0, 0.0) for step in range(6)]
    half = [script.Point("b", 0, point.kilobytes / 2, point.footage_psnr, 0.0, 0.0, 0.0) for point in curve]
    far = [script.Point("c", 0, 1.0, 90.0 + step, 0.0, 0.0, 0.0) for step in range(3)]
    assert script.bd_rate(curve, half, "footage_psnr") == pytest.approx(-50)
    assert script.bd_rate(curve, far, "footage_psnr") is None
    assert script.kilobytes_at(curve, 32.0) == pytest.approx(14.4)
