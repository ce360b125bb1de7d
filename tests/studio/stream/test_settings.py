import pytest

from studio.stream import BakeSettings
from tests.support.default_settings import defaults, recorded
from tests.support.settings import refuses_setting


@pytest.mark.parametrize("qp", [0, 10, 22])
def test_up_to_22_all_alike(qp):
    settings = BakeSettings(profile="planes", qp=qp)
    assert {settings.attribute_qp(a) for a in ("means_low", "opacities", "scales", "quats", "sh")} == {qp}
    assert settings.attribute_qp("means_high") == 0


def test_above_22_color_scale_and_rotation_stay():
    settings = BakeSettings(profile="planes", qp=30)
    assert [settings.attribute_qp(a) for a in ("sh", "scales", "quats")] == [22, 22, 22]
    assert [settings.attribute_qp(a) for a in ("means_low", "opacities")] == [30, 30]
    assert settings.attribute_qp("means_high") == 0


def test_override_wins():
    settings = BakeSettings(profile="planes", qp=30, attribute_qps={"sh": 35, "means_low": 5})
    assert settings.attribute_qp("sh") == 35
    assert settings.attribute_qp("means_low") == 5


@pytest.mark.parametrize(
    "wrong",
    [
        {"qp": 52},
        {"qp": -1},
        {"qp": 1.5},
        {"attribute_qps": {"means_high": 10}},
        {"attribute_qps": {"sh": 99}},
        {"codec": "vp9"},
        {"preset": "best"},
    ],
)
def test_wrong_settings_are_refused(wrong):
    with refuses_setting(*wrong):
        BakeSettings(profile="planes", **wrong)


def test_contradictions_are_refused():
    with refuses_setting("target_kb_per_frame", "target_psnr"):
        BakeSettings(target_kb_per_frame=30, target_psnr=40)
    with refuses_setting("codec", "profile"):
        BakeSettings(profile="planes", codec="av1")
    with refuses_setting("codec", "qp"):
        BakeSettings(codec="av1").at_qp(0)


def test_defaults():
    found, record = defaults(BakeSettings), recorded("bake")
    assert found == {name: record[name] for name in found}
