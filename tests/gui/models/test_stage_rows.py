import pytest

from v3studio.gui.models.stage_rows import message_text
from v3studio.pipelines.events import Warned
from v3studio.studio.errors import StudioError


@pytest.mark.parametrize(
    ("code", "page"), [("take.not_trained", "Run Train."), ("take.damaged", "Run Train again."), ("run.failed", "")]
)
def test_the_stage_that_fixes_an_error_is_named_as_its_page(code: str, page: str) -> None:
    command = "Run `v3studio train`."
    error = StudioError(code, "no frames", file="takes/first", fix=command, stage="train")
    assert message_text(error) == f"takes/first: no frames. {page or command}"
    assert message_text(Warned.of(error.message)) == message_text(error), "as events of a child process"


def test_an_error_of_no_stage_keeps_its_words() -> None:
    error = StudioError("take.damaged", "the file is damaged", fix="Copy it again.")
    assert message_text(error) == str(error)
