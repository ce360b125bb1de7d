"""The dialog for a new take: what it says of the footage."""

from pathlib import Path

from gui.widgets.dialogs.take import words_beside
from pipelines.new_take import NewTake


def test_what_the_image_shows_is_not_said_again(footage_project: Path) -> None:
    """That no camera is held out would be false after a click on one."""
    found = NewTake(footage=str(footage_project / "capture"), fps="25").found()
    assert found.inspection.suggested
    assert "capture.held_out" in found.words
    assert "held" not in words_beside(found)
    assert "cameras.json" in words_beside(found)
