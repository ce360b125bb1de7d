"""The log says figures with words and units."""

from __future__ import annotations

from gui.models.take.run_state import RunState
from pipelines.events import StageFinished


def test_a_finished_stage_says_what_it_made() -> None:
    run = RunState()
    run.apply(StageFinished(stage="bake", seconds=9, summary={"frames": 30, "groups": 2, "bytes": 925_207}))
    assert run.lines[-1].text == "Bake: done in 9.0 s. 30 frames in 2 groups, 925.2 KB"
