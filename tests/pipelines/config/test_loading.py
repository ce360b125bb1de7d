from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipelines.config import Config, describe, dump_config, load_config, parse_override
from pipelines.config.loading import all_names
from pipelines.stages.arguments import bake_settings, capture_spec, hull_settings, sfm_settings, train_settings
from studio.errors import StudioError


def write(folder: Path, text: str) -> Path:
    path = folder / "run.yaml"
    path.write_text(text)
    return path


def refusal(folder: Path, text: str, *overrides: str) -> str:
    with pytest.raises(StudioError) as caught:
        load_config(write(folder, text), [parse_override(override) for override in overrides])
    return str(caught.value)


def test_defaults_are_the_papers():
    config = Config()
    assert config.train.group_size == 20
    assert (config.train.motion_iterations, config.train.finetune_iterations) == (500, 2000)
    assert (config.train.dssim_weight, config.train.temporal_weight, config.train.entropy_weight) == (0.2, 1e-3, 1e-5)
    assert (config.train.prune_ratio, config.train.max_splats) == (0.3, 100_000)
    assert (config.train.hash_levels, config.train.hash_features) == (16, 4)
    assert (config.train.mlp_width, config.train.mlp_layers) == (64, 2)


@pytest.mark.parametrize(
    ("section", "make", "theirs"),
    [
        ("train", train_settings, {"snapshot_every"}),
        ("initialize", hull_settings, set()),
        ("calibrate", lambda section: sfm_settings(section, Config().run), {"threads", "seed"}),
        ("bake", lambda section: bake_settings(section, 1), {"threads"}),
        ("capture", capture_spec, {"cache_bytes", "mask_device", "mask_threads"}),
    ],
)
def test_every_argument_of_the_library_can_be_set(section, make, theirs):
    """A setting that the library gains is missing here until it can be set; `theirs` are chosen elsewhere."""
    values = getattr(Config(), section)
    made = make(values)
    assert {field.name for field in fields(made)} - theirs <= set(type(values).model_fields)
    for field in fields(made):
        if field.name not in theirs and field.name != "rates":
            assert getattr(made, field.name) == getattr(values, field.name)


def test_every_setting_is_documented():
    def check(model, where):
        for name, field in model.model_fields.items():
            assert field.description, f"{where}.{name} has no documentation"
            if hasattr(field.annotation, "model_fields"):
                check(field.annotation, f"{where}.{name}")

    for section, field in Config.model_fields.items():
        check(field.annotation, section)


def test_description_is_a_configuration_with_the_same_values(tmp_path):
    text = describe(Config.model_validate({"train": {"max_splats": 1234}, "bake": {"attribute_qps": {"sh": 30}}}))
    config = load_config(write(tmp_path, text))
    assert config.train.max_splats == 1234
    assert config.bake.attribute_qps == {"sh": 30}
    assert all(f"{name.rsplit('.', 1)[-1]}:" in text for name in all_names())
    assert "[0 to 51]" in text
    assert "[one of random, black, white]" in text


def test_dumped_settings_read_back_the_same(tmp_path):
    before = load_config(write(tmp_path, "capture: {root: here, held_out: [a, b]}\ntrain: {rates: {opacity: 0.02}}"))
    assert load_config(write(tmp_path, dump_config(before))) == before


def test_root_is_relative_to_the_file_but_on_the_command_line_to_the_working_folder(tmp_path, monkeypatch):
    (tmp_path / "configs").mkdir()
    path = write(tmp_path / "configs", "capture: {root: ../footage}")
    assert load_config(path).capture.root == tmp_path / "footage"
    monkeypatch.chdir(tmp_path)
    assert load_config(path, [("capture.root", "other")]).capture.root == tmp_path / "other"


@pytest.mark.parametrize(
    ("text", "name", "nearest"),
    [
        ("train: {max_splat: 3}", "train.max_splat", "train.max_splats"),
        ("bake: {group_size: 3}", "bake.group_size", "train.group_size"),
        ("trian: {max_splats: 3}", "trian", "train"),
        ("train: {rates: {opacty: 3}}", "train.rates.opacty", "train.rates.opacity"),
        ("max_splats: 5", "max_splats", "train.max_splats"),
    ],
)
def test_unknown_setting_names_the_file_and_the_nearest(tmp_path, text, name, nearest):
    message = refusal(tmp_path, text)
    assert message.startswith(f"{tmp_path / 'run.yaml'}: {name} is not a setting.")
    assert message.endswith(f"The nearest is {nearest}.")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bake: {qp: 80}", "bake.qp = 80 must be less than or equal to 51."),
        ("bake: {target_psnr: 40, target_kb_per_frame: 30}", "both set"),
        ("bake: {profile: planes, codec: av1}", "codec = av1"),
        ("train: {max_splats: many}", "train.max_splats = 'many' must be a valid integer"),
        ("train: {background: green}", "train.background = 'green' must be 'random', 'black' or 'white'."),
        ("capture: {scale: .nan}", "capture.scale = nan must"),
        ("capture: {background: [0, 0, 2]}", "capture.background.2 = 2 must be less than or equal to 1."),
        ("capture: {start: 5, stop: 5}", "stop = 5 must lie behind start = 5"),
        ("capture: {held_out: [a, a]}", "held_out names a camera twice (a, a)"),
        ("run: {device: tpu}", "must be auto, cpu, cuda or cuda:N (found 'tpu')"),
        ("train: 3", "train = 3 must be a section with settings of its own."),
        ("train: {max_splats: 3, max_splats: 4}", "the key 'max_splats' is written twice"),
        ("train: [", "line 1"),
        ("- train", "expected sections such as 'capture:' and 'train:', found list"),
    ],
)
def test_impossible_value_is_one_sentence_with_file_and_value(tmp_path, text, expected):
    message = refusal(tmp_path, text)
    assert message.startswith(str(tmp_path / "run.yaml"))
    assert expected in message
    assert message.endswith(".")


def test_two_mistakes_are_two_lines(tmp_path):
    assert len(refusal(tmp_path, "bake: {qp: 80}\ntrain: {nonsense_zzz: 1}").splitlines()) == 2


def test_a_mistake_on_the_command_line_is_not_blamed_on_the_file(tmp_path):
    assert refusal(tmp_path, "", "bake.qp=80").startswith("the command line: bake.qp = 80")


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(StudioError, match="there is no such file"):
        load_config(tmp_path / "none.yaml")
    with pytest.raises(StudioError, match="is a folder"):
        load_config(tmp_path)


def test_numbers_with_exponents_are_numbers(tmp_path):
    """YAML 1.1, and so PyYAML by itself, reads 1e-3 as text."""
    assert load_config(write(tmp_path, "train: {entropy_weight: 2e-3}")).train.entropy_weight == 2e-3
    assert parse_override("train.entropy-weight=1e-3") == ("train.entropy_weight", 1e-3)


def test_empty_sections_and_files_are_defaults(tmp_path):
    assert load_config(write(tmp_path, "train:\n  # all commented out\n")).train == Config().train
    assert load_config(write(tmp_path, "")).train == Config().train


@pytest.mark.parametrize("text", ["train.max_splats", "max_splats=3", "=3", "train.x=[1"])
def test_malformed_overrides(text):
    with pytest.raises(StudioError):
        parse_override(text)


def test_override_through_a_plain_value_is_refused(tmp_path):
    assert "has no settings of its own" in refusal(tmp_path, "train: {max_splats: 3}", "train.max_splats.x=3")


@pytest.mark.parametrize("root", ['"\\0"', "~nobody-of-that-name/x"])
def test_a_root_that_can_be_no_folder(tmp_path: Path, root: str) -> None:
    assert "can be no folder" in refusal(tmp_path, f"capture: {{root: {root}}}")


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.dictionaries(st.sampled_from(["train", "bake", "capture", "zzz"]), st.dictionaries(
    st.sampled_from(["qp", "max_splats", "scale", "root", "bogus"]),
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.integers())),
)))  # fmt: skip
def test_any_yaml_is_read_or_refused_with_a_sentence(tmp_path_factory, values):
    path = write(tmp_path_factory.mktemp("any"), yaml.safe_dump(values))
    message = None
    try:
        load_config(path)
    except StudioError as error:
        message = str(error)
    assert message is None or str(path) in message


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parents[3] / "sample_configs").glob("*.yaml")), ids=lambda p: p.stem
)
def test_sample_configurations_are_valid(path):
    load_config(path)


def test_a_rule_over_several_settings_names_the_command_line_too(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("capture: {root: .}\n")
    with pytest.raises(StudioError, match=r"a\.yaml with the command line: capture: .*stop"):
        load_config(path, [("capture.start", 20), ("capture.stop", 4)])


@pytest.mark.parametrize(
    ("value", "kind"), [("2026-02-30", "date"), ("!!int abc", "number"), ("!!float x", "number"), ("!!bool 3", "truth")]
)
def test_values_that_yaml_cannot_make(tmp_path, value, kind):
    """PyYAML raises ValueError or KeyError there, in Python's own words."""
    (tmp_path / "a.yaml").write_text(f"train:\n  max_splats: {value}\n")
    with pytest.raises(StudioError, match=rf"a\.yaml, line 2: '.*' is no {kind}.*though it is written as one"):
        load_config(tmp_path / "a.yaml")
    with pytest.raises(StudioError, match=r"The value of train\.max_splats, .* cannot be read"):
        parse_override(f"train.max_splats={value}")


def test_a_superscript_is_no_device():
    with pytest.raises(StudioError, match="must be auto, cpu, cuda or cuda:N"):
        load_config(None, [("run.device", "cuda:²")])
