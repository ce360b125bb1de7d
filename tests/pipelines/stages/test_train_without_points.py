"""Frames are never trained under keys that leave their initial points out."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipelines.takes.frame_files import read_about
from pipelines.takes.take import Take


def test_a_report_that_is_not_there_stops_training(take: Take, here: Callable[..., Any], tmp_path: Path) -> None:
    away = tmp_path / "report.json"
    frame, report = take.trained_frame(0, 0), take.initialize_group(0) / "report.json"
    key = read_about(frame).key  # type: ignore[union-attr]
    frame.unlink()
    report.rename(away)  # as another machine sees it that a network file system has not told of it yet
    here("train", take.root).fails("report.json: ")
    assert not frame.exists()
    away.rename(report)
    here("train", take.root).ok()
    assert read_about(frame).key == key  # type: ignore[union-attr]
