"""Names of garbage masks in a take."""

from pathlib import Path

from pipelines.config import Config
from pipelines.takes.drawn_masks import DRAWN, file_of_garbage, with_garbage_of
from pipelines.takes.take import Take
from studio.capture import CaptureSettings

DRAWN_IN = Config(capture=CaptureSettings(garbage_masks=DRAWN))


def test_the_name_is_that_of_the_takes_own_file(tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    assert file_of_garbage(DRAWN_IN.capture, take) == take.garbage
    assert with_garbage_of(DRAWN_IN.capture, take).garbage_masks == str(take.garbage)
    for other in (None, "garbage.yaml", "garbage/{camera}.png"):  # in the capture's folder
        capture = CaptureSettings(garbage_masks=other)
        assert file_of_garbage(capture, take) is None
        assert with_garbage_of(capture, take) == capture
