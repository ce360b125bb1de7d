"""The benchmark of the stream's speed runs on a take."""

from pathlib import Path

import pytest

from benchmarks import stream_speed


def test_the_table_of_a_take(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stream_speed, "SPLATS", (500,))
    stream_speed.main([str(finished / "take")])
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["500"]]
    assert all(float(row[2]) > 0 and float(row[-1]) > 0 for row in rows)
