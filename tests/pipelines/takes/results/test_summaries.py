"""Main figures of stages in words."""

import pytest

from v3studio.pipelines.takes.results.summaries import CalibrateSummary


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"source": "file"}, ["1 camera from a camera file", "", "", ""]),
        ({"source": "board", "grade": "good"}, ["1 camera from the board", "checked: good", "", ""]),
        (
            {"source": "footage", "mean_error_px": 0.456, "match_inlier_ratio": 0.913},
            ["1 camera from the footage", "", "mean reprojection error 0.46 px", "91% of the matches agree"],
        ),
    ],
)
def test_what_is_not_known_is_left_out(figures: dict[str, object], words: list[str]) -> None:
    assert CalibrateSummary.model_validate({"cameras": 1, **figures}).words == words
