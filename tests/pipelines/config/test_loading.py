from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.errors import refuses
from v3studio.pipelines.config import Config, describe, load_config, parse_override
from v3studio.studio.capture.settings import CaptureSettings
from v3studio.studio.errors import StudioError
from v3studio.studio.settings import affected
from v3studio.studio.yaml_text import dump_yaml


def write(folder: Path, text: str) -> Path:
    path = folder / "run.yaml"
    path.write_text(text)
    return path


def load(folder: Path, text: str, *overrides: str) -> Config:
    return load_config(write(folder, text), [parse_override(override) for override in overrides])


@pytest.mark.parametrize("given", ["{camera}/video.avi", "'{camera}/video.avi'", '"{camera}/video.avi"'])
def test_text_needs_no_quotes_on_the_command_line(given: str) -> None:
    assert parse_override(f"capture.images={given}") == ("capture.images", "{camera}/video.avi")
    assert parse_override("capture.images={camera}") == ("capture.images", "{camera}")
    assert parse_override("capture.root=2024")[1] == "2024"
    assert parse_override("capture.rig=null")[1] is None
    assert parse_override("capture.cameras=[a, b]")[1] == ["a", "b"]
    with refuses("settings.override_syntax", setting="capture.cameras"):
        parse_override("capture.cameras=[a")


def test_description_is_a_configuration_with_the_same_values(tmp_path: Path) -> None:
    text = describe(Config.model_validate({"train": {"max_splats": 1234}, "bake": {"attribute_qps": {"sh": 30}}}))
    config = load_config(write(tmp_path, text))
    assert config.train.max_splats == 1234
    assert config.bake.attribute_qps == {"sh": 30}
    assert all(f"{name.rsplit('.', 1)[-1]}:" in text for name in affected(Config))
    assert "[0 to 51]" in text
    assert "[one of random, black, white]" in text


def test_root_is_relative_to_the_file_but_on_the_command_line_to_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
def test_unknown_setting_names_the_file_and_the_nearest(tmp_path: Path, text: str, name: str, nearest: str) -> None:
    with refuses("settings.unknown", file=tmp_path / "run.yaml", setting=name) as caught:
        load(tmp_path, text)
    assert f"Did you mean {nearest}?" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "setting", "value", "hint"),
    [
        ("bake: {quality: 80}", "bake.quality", 80, "a size such as 40 KB"),
        ("train: {max_splats: many}", "train.max_splats", "many", "a whole number. The default is 100000."),
        ("train: {background: green}", "train.background", "green", "random, black or white"),
        ("evaluate: {background: [0, 0, 2]}", "evaluate.background", 2, "background.2 = 2 must be at most 1"),
        ("run: {device: tpu}", "run.device", "tpu", "auto, cpu, cuda or cuda:N"),
        ("run: {device: 'cuda:²'}", "run.device", "cuda:²", "auto, cpu, cuda or cuda:N"),
        ("capture: {key_color: [0.5, 0.5, 0.5]}", "capture.key_color", [0.5, 0.5, 0.5], "Use a saturated color"),
        ("train: 3", "train", 3, "Indent settings under it"),
        ("calibrate: {board: {marker: 0.07}}", "calibrate.board", None, "0.07 m is not smaller than square = 0.06 m"),
    ],
)
def test_an_invalid_value_is_reported_with_file_value_and_hint(
    tmp_path: Path, text: str, setting: str, value: Any, hint: str
) -> None:
    with refuses("settings.invalid", file=tmp_path / "run.yaml", value=value, setting=setting) as caught:
        load(tmp_path, text)
    assert hint in str(caught.value)


@pytest.mark.parametrize(
    ("text", "settings"),
    [
        ("bake: {quality: 40 KB, ladder: [{qp: 20}]}", ["bake.ladder", "bake.quality"]),
        ("capture: {held_out: [a, a]}", ["capture.held_out"]),
        ("capture: {held_out: [every 1]}", ["capture.held_out"]),
        ("calibrate: {intrinsics_groups: [[a]]}", ["calibrate.intrinsics_groups"]),
        ("calibrate: {intrinsics_groups: [[a, b], [b, c]]}", ["calibrate.intrinsics_groups"]),
        ("calibrate: {board: {dictionary: DICT_9X9}}", ["calibrate.board.dictionary"]),
    ],
)
def test_contradictions_name_their_settings(tmp_path: Path, text: str, settings: Any) -> None:
    with refuses("settings.invalid", file=tmp_path / "run.yaml", settings=settings) as caught:
        load(tmp_path, text)
    assert caught.value.fix


@pytest.mark.parametrize(
    ("text", "line"), [("train: {max_splats: 3, max_splats: 4}", 1), ("bake:\n  qp: [", 2), ("- train", None)]
)
def test_files_that_are_not_settings(tmp_path: Path, text: str, line: Any) -> None:
    with refuses("settings.not_yaml", file=tmp_path / "run.yaml") as caught:
        load(tmp_path, text)
    assert caught.value.fields.get("line") == line


def test_a_mistake_in_an_override_is_not_blamed_on_the_file(tmp_path: Path) -> None:
    with refuses("settings.invalid", file="overrides", value=80, setting="bake.quality"):
        load(tmp_path, "", "bake.quality=80")
    both = f"{tmp_path / 'run.yaml'} and overrides"
    with refuses("settings.invalid", file=both, settings=["bake.ladder", "bake.quality"]):
        load(tmp_path, "bake: {ladder: [{qp: 20}]}", "bake.quality=40 KB")


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with refuses("settings.file_not_found", file=tmp_path / "none.yaml"):
        load_config(tmp_path / "none.yaml")
    with refuses("settings.unreadable", file=tmp_path):
        load_config(tmp_path)


@pytest.mark.parametrize("text", ["cam05, cam12", "cam05,cam12", "[cam05, cam12]"])
def test_a_list_needs_no_brackets(tmp_path: Path, text: str) -> None:
    assert load_config(None, [parse_override(f"capture.held_out={text}")]).capture.held_out == ("cam05", "cam12")
    config = load(tmp_path, f"capture: {{held_out: '{text.strip('[]')}'}}\nevaluate: {{background: '0, 0.5, 1'}}")
    assert config.capture.held_out == ("cam05", "cam12")
    assert config.evaluate.background == (0, 0.5, 1)
    for wrong in ("a: b", "", "&a [*a]", "0, red, 1"):
        with refuses("settings.invalid"):
            load_config(None, [("evaluate.background", wrong)])


@pytest.mark.parametrize("text", ["01,02", "yes, no", "010", "[1:30, 02]", '7, "08"'])
def test_names_in_lists_stay_as_they_are(tmp_path: Path, text: str) -> None:
    names = tuple(name.strip(' "') for name in text.strip("[]").split(","))
    assert load_config(None, [parse_override(f"capture.held_out={text}")]).capture.held_out == names
    if not text.startswith("["):  # a list with brackets in a file is YAML
        assert load(tmp_path, f"capture: {{held_out: '{text}'}}").capture.held_out == names
    groups = load_config(None, [parse_override("calibrate.intrinsics_groups=[[01, 02], [no, 04]]")])
    assert groups.calibrate.intrinsics_groups == (("01", "02"), ("no", "04"))


def test_override_through_a_plain_value_is_refused(tmp_path: Path) -> None:
    with refuses("settings.unknown", setting="train.max_splats.x", value=3):
        load(tmp_path, "train: {max_splats: 3}", "train.max_splats.x=3")


FRAMES = [("frames", f"'{text}'") for text in ("5", "9:3", "4:4", "::0", "a:b", "-3:")]


@pytest.mark.parametrize(
    ("name", "value"), [*FRAMES, ("root", '"\\0"'), ("root", "~nobody-of-that-name/x"), ("scale", ".nan")]
)
def test_values_that_are_no_ranges_paths_or_numbers(tmp_path: Path, name: str, value: str) -> None:
    with refuses("settings.invalid", file=tmp_path / "run.yaml", setting=f"capture.{name}"):
        load(tmp_path, f"capture: {{{name}: {value}}}")


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.dictionaries(st.sampled_from(["train", "bake", "capture", "zzz"]), st.dictionaries(
    st.sampled_from(["qp", "max_splats", "scale", "root", "bogus"]),
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.lists(st.integers())),
)))  # fmt: skip
def test_any_yaml_is_read_or_refused_with_a_sentence(tmp_path_factory: pytest.TempPathFactory, values: Any) -> None:
    path = write(tmp_path_factory.mktemp("any"), dump_yaml(values))
    message = None
    try:
        load_config(path)
    except StudioError as error:
        message = str(error)
    assert message is None or str(path) in message


@pytest.mark.parametrize(
    "path", sorted((Path(__file__).parents[3] / "sample_configs").glob("*.yaml")), ids=lambda p: p.stem
)
def test_sample_configurations_are_valid(path: Path) -> None:
    load_config(path)


def test_credentials_in_an_address_are_not_repeated() -> None:
    with pytest.raises(StudioError, match=r"capture\.root contains credentials") as caught:
        load_config(None, [("capture.root", "s3://AKIA:abc/hidden@studio/day1")])
    assert "hidden" not in str(caught.value.message.to_dict())


def test_names_that_look_like_numbers_stay_text(tmp_path: Path) -> None:
    text = "capture: {held_out: [04, 1e4, true], cameras: '07, 08', offsets: {010: 2}, audio: 0123, fps: 25}"
    capture = load(tmp_path, text).capture
    assert capture.held_out == ("04", "1e4", "true")
    assert load(tmp_path, "capture: {held_out: 04}").capture.held_out == ("04",)
    given = load_config(None, [("capture.held_out", [8, 18])]).capture
    assert given == CaptureSettings(held_out=(8, 18)) == CaptureSettings(held_out=("8", "18"))  # type: ignore[arg-type]
    assert capture.cameras == ("07", "08")
    assert capture.offsets == {"010": 2}
    assert (capture.audio, capture.fps) == ("0123", 25.0)
