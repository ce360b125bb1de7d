from tests.support.tiny_capture import ROOT
from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.config.config import values_of
from v3studio.pipelines.config.presets import PRESETS, differing, preset_of, with_values


def test_all_presets_set_the_same_valid_settings() -> None:
    names = {tuple(preset) for preset in PRESETS.values()}
    assert len(names) == 1
    for name, values in PRESETS.items():
        config = with_values(Config(), values)
        assert preset_of(config) == name
        assert differing(config, name) == {}
        assert values_of(config).items() >= dict(values).items()


def test_standard_has_the_schedule_of_the_sample() -> None:
    sample = load_config(ROOT / "sample_configs" / "quickstart.yaml")
    assert preset_of(sample) == "standard"
    assert set(differing(sample, "standard")) == {
        "initialize.resolution", "train.alpha_weight", "train.scale_reg", "train.dropout", "train.crop_margin",
    }  # fmt: skip
