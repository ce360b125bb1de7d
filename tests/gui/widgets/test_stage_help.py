"""Every stage says what to look for, with two different real pictures."""

from gui.models.stage_rows import TITLES
from gui.widgets.stage_help import HELP, KINDS, PICTURES


def test_every_stage_has_help_and_pictures_that_are_small_files() -> None:
    assert set(HELP) == set(TITLES)
    files = {f"{stage}_{kind}.jpg" for stage in HELP for kind in KINDS}
    assert {path.name for path in PICTURES.iterdir()} == files
    assert sum(path.stat().st_size for path in PICTURES.iterdir()) < 500_000
    for stage, found in HELP.items():
        assert len(found.points) >= 2, stage
        assert found.good
        assert found.bad
        assert found.settings
