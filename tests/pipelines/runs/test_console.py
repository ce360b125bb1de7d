"""What a run prints for people."""

import pytest

from pipelines.events import Finished, Log, StageFinished, Warned
from pipelines.runs.console import MOST_ALIKE, Bars


def test_warnings_of_one_kind_are_grouped(capfd: pytest.CaptureFixture[str]) -> None:
    with Bars() as show:
        for camera in range(30):
            show(Warned(stage="train", message=f"camera {camera} is dark", code="camera.dark"))
        show(Warned(stage="train", message="another", code="camera.other"))
        show(StageFinished(stage="train", seconds=1.0))
        show(Warned(stage="bake", message="dark again", code="camera.dark"))
        show(Finished(outcome="done", seconds=2.0))
    lines = [line for line in capfd.readouterr().out.splitlines() if line.startswith("warning: ")]
    assert sum("is dark" in line for line in lines) == MOST_ALIKE
    assert sum(f"{30 - MOST_ALIKE} more" in line for line in lines) == 1
    assert [line for line in lines if "another" in line or "again" in line] == [
        "warning: another",
        "warning: dark again",
    ]
    assert len(lines) == MOST_ALIKE + 3


def test_what_was_found_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    with Bars() as show:
        show(Log(stage="initialize", message="Masks: alpha channel [of the images]."))
    assert "Masks: alpha channel [of the images]." in capfd.readouterr().out
