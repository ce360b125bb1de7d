from typing import Any

import pytest

from tests.support.settings import refuses_setting
from v3studio.studio.stream import BakeSettings


@pytest.mark.parametrize(
    "wrong",
    [
        *(
            {"quality": wrong}
            for wrong in (52, -1, 1.5, True, "0 dB", "200 dB", "x dB", "4 MB", "0.4 dB loss", "best", "", None)
        ),
        {"attribute_qps": {"quats": 10}},
        {"attribute_qps": {"sh": 99}},
        {"preset": "best"},
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, Any]) -> None:
    with refuses_setting(*wrong):
        BakeSettings(**wrong)


@pytest.mark.parametrize(
    ("given", "stored", "goals"),
    [
        (24, 24, (24, None, None)),
        ("22", 22, (22, None, None)),
        ("40KB", "40 KB", (22, 40.0, None)),
        ("42.50 dB", "42.5 dB", (22, None, 42.5)),
        (" fine ", "fine", (22, None, 42.0)),
    ],
)
def test_kinds_of_quality(given: int | str, stored: int | str, goals: tuple[int, float | None, float | None]) -> None:
    settings = BakeSettings(quality=given)
    assert settings.quality == stored
    assert (settings.qp, settings.target_kb_per_frame, settings.target_psnr) == goals
    assert BakeSettings.model_validate(settings.model_dump(mode="json")) == settings
