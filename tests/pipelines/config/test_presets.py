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


def test_defaults_are_those_of_the_papers_and_the_guides() -> None:
    train, rates, bake = Config().train, Config().train.rates, Config().bake
    # V3
    assert (train.prune_ratio, train.max_splats, train.prune_by) == (0.3, 100_000, "opacity")
    assert (train.motion_iterations, train.finetune_iterations, train.finetune_means) == (500, 2000, False)
    assert (train.hash_levels, train.mlp_layers, train.mlp_width) == (16, 2, 64)
    assert (train.dssim_weight, train.temporal_weight) == (0.2, 1e-3)
    # 3DGS
    assert (rates.sh_dc, rates.sh_rest, rates.opacity) == (0.0025, 0.0025 / 20, 0.05)
    assert (rates.scale, rates.rotation) == (0.005, 0.001)
    assert (train.densify_from, train.densify_every, train.sh_degree_every) == (500, 100, 1000)
    # docs/guides/bake.md
    assert (train.group_size, bake.quality, bake.profile, bake.codec) == (30, 22, "motion", "h264")
