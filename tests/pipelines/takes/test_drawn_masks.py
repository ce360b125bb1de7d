"""Names of garbage masks in a take."""

from pathlib import Path

from pipelines.config import Config
from pipelines.takes.drawn_masks import DRAWN, file_of_garbage, for_another_take, with_garbage_of
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


def test_settings_that_another_take_begins_with_name_the_first_takes_file(tmp_path: Path) -> None:
    path = tmp_path / "first" / "config.yaml"
    found = for_another_take(DRAWN_IN, path, tmp_path / "second")
    assert found.capture.garbage_masks == str(tmp_path / "first" / "garbage.yaml")
    assert for_another_take(DRAWN_IN, path).capture.garbage_masks == str(tmp_path / "first" / "garbage.yaml")
    assert for_another_take(DRAWN_IN, path, tmp_path / "first") == DRAWN_IN
    assert for_another_take(DRAWN_IN, None, tmp_path / "second") == DRAWN_IN
    plain = Config()
    assert for_another_take(plain, path, tmp_path / "second") == plain
