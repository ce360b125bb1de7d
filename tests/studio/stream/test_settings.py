from typing import Any

import pytest

from tests.support.settings import refuses_setting
from v3studio.studio.stream import BakeSettings
from v3studio.studio.stream.attributes import ATTRIBUTES


@pytest.mark.parametrize(
    ("given", "qps"), [({}, [30, 22, 22, 30, 22]), ({"sh": 35, "means_low": 5}, [5, 22, 22, 30, 35])]
)
def test_above_22_color_scale_and_rotation_stay_unless_they_are_set(given: dict[str, int], qps: list[int]) -> None:
    settings = BakeSettings(profile="planes", quality=30, attribute_qps=given)
    assert [settings.attribute_qp(attribute) for attribute in ATTRIBUTES] == qps


@pytest.mark.parametrize(
    "wrong",
    [
        *(
            {"quality": wrong}
            for wrong in (52, -1, 1.5, True, "0 dB", "200 dB", "x dB", "4 MB", "0.4 dB loss", "best", "", None)
        ),
        {"attribute_qps": {"means_high": 10}},
        {"attribute_qps": {"sh": 99}},
        {"codec": "no-such-codec"},
        {"preset": "best"},
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, Any]) -> None:
    with refuses_setting(*wrong):
        BakeSettings(profile="planes", **wrong)


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


@pytest.mark.parametrize(
    "given",
    [
        {"codec": "av1", "profile": "planes"},
        {"b_frames": 2, "codec": "av1"},
        {"b_frames": 2, "profile": "planes"},
        {"smooth_paths": True, "profile": "planes"},
    ],
)
def test_contradictions_are_refused(given: dict[str, Any]) -> None:
    with refuses_setting(*given):
        BakeSettings(**given)
    with refuses_setting("codec", "quality"):
        BakeSettings(codec="av1").at_qp(0)
