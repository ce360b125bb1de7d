import json

from pipelines.config import Config, load_config
from pipelines.config.presets import PRESETS, differing, preset_of, values_of, with_values
from tests.support.tiny_capture import ROOT


def test_all_presets_set_the_same_valid_settings() -> None:
    names = {tuple(preset) for preset in PRESETS.values()}
    assert len(names) == 1
    for name, values in PRESETS.items():
        config = with_values(Config(), values)
        assert preset_of(config) == name
        assert differing(config, name) == {}
        assert values_of(config).items() >= dict(values).items()


def test_final_has_the_defaults_and_standard_the_schedule_of_the_sample() -> None:
    assert with_values(Config(), PRESETS["final"]) == Config()
    sample = load_config(ROOT / "sample_configs" / "quickstart.yaml")
    assert preset_of(sample) == "standard"
    assert set(differing(sample, "standard")) == {
        "initialize.resolution", "train.alpha_weight", "train.scale_reg", "train.dropout", "train.crop_margin",
    }  # fmt: skip


def test_all_sections_have_the_recorded_defaults() -> None:
    """A changed default changes what users get from the same configuration, and makes their takes stale: change it in
    tests/data/default_settings.json as well, and describe it in CHANGELOG.md."""
    recorded = json.loads((ROOT / "tests" / "data" / "default_settings.json").read_text(encoding="utf-8"))
    for section, found in Config().model_dump(mode="json").items():
        assert found == recorded[section], section
