"""What the inspector tells of a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from gui.models.take.inspector import run_blocks
from gui.models.take.workspace import Workspace
from pipelines.events import Progress, StageStarted
from pipelines.takes.take import Take


@pytest.mark.parametrize(("more", "told"), [(2051, True), (0, False)])
def test_more_splats_than_the_limit_are_said_to_be_pruned(finished: Path, more: int, told: bool) -> None:
    workspace = Workspace()
    workspace.open(Take.open(finished / "take"))
    assert workspace.config is not None
    limit = workspace.config.train.max_splats
    workspace.run.apply(StageStarted(stage="train", reason="never run"))
    assert workspace.run.lines[-1] == ("", "Train: started (never run)")
    figures = {"splats": limit + more}
    workspace.run.apply(Progress(stage="train", fraction=0.5, figures=figures))
    workspace.holder = {"pid": 1}
    rows = dict(run_blocks(workspace, "train")[0].rows)
    assert rows["splats"] == f"{limit + more:,}"
    assert rows.get("after pruning") == (f"{limit:,} at most" if told else None)
    assert workspace.close()
