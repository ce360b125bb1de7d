"""Figures say whose they are."""

from __future__ import annotations

from pathlib import Path

from gui.models.evaluation import Evaluation


def test_nothing_is_said_of_cameras_before_they_were_evaluated(finished: Path) -> None:
    none = Evaluation()
    assert (none.whose(), none.whose_briefly(), none.explanation) == ("mean", "mean", "")
    found = Evaluation.read(finished / "take" / "evaluation.json")
    assert found.held_out
    assert (found.whose(), found.whose_briefly()) == ("mean of held-out cameras", "held-out mean")
    camera = found.cameras[0]
    assert (found.whose(camera), found.whose_briefly(camera)) == (f"camera {camera}", camera)
