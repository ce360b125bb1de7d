"""Every stage says what to look for, with two different real pictures."""

from __future__ import annotations

import numpy as np
import pytest

from gui.drawing.palette import BAD, GOOD
from gui.models.stage_rows import TITLES
from gui.widgets.stage_help import HELP, KINDS, PICTURES, example_of, help_image


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


@pytest.mark.parametrize(("width", "em"), [(800, 16.0), (1600, 32.0), (300, 16.0)])
def test_the_help_shows_sentences_and_both_pictures(width: int, em: float) -> None:
    shown = help_image("train", width, em)
    assert shown.shape[1] == width
    good, bad = ((np.abs(shown.astype(int) - color).sum(axis=2) < 12).any(axis=0) for color in (GOOD, BAD))
    assert good[: width // 2].any()
    assert bad[width // 2 :].any()
    each = (width - em) / 2
    high = each * example_of("train", "good").shape[0] / example_of("train", "good").shape[1]
    assert shown.shape[0] > high + 3 * em, "sentences above, captions below"
