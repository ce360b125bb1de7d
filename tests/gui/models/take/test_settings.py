import pytest

from v3studio.gui.models.take.page_words import value_words
from v3studio.gui.models.take.settings import SECTIONS, SettingField, fields_of
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.staleness import differences

OPTIONAL = [field for stage in SECTIONS for field in fields_of(stage) if field.nullable]


@pytest.mark.parametrize("field", OPTIONAL, ids=lambda field: field.name)
def test_a_setting_without_a_value_shows_a_word_and_can_be_without_a_value_again(field: SettingField) -> None:
    empty = load_config(None, [(field.name, None)])
    shown = field.shown(empty)
    assert shown == field.empty != ""
    if field.kind == "choice":
        assert field.choices.count(shown) == 1, "else the combobox shows its first choice"
    for text in (shown, shown.upper(), "", " null "):
        assert field.parsed(text) is None
    assert load_config(None, [(field.name, field.parsed(shown))]) == empty


def test_no_field_is_empty_at_first() -> None:
    config = load_config(None, [])
    assert not [field.name for stage in SECTIONS for field in fields_of(stage) if not field.shown(config)]


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("capture.offsets", {"cam1": 2, "cam2": -1}, "cam1: 2, cam2: -1"),
        ("capture.mask_labels", [1, 5], "1, 5"),
        ("capture.cameras", [], "all"),
        ("capture.cameras", ["1", "cam 2", "off"], "1, cam 2, off"),
        ("capture.masks", "clean_plate", "clean plate"),
        ("capture.masks", "mine_own:Masks", "mine_own:Masks"),
        ("calibrate.shared_intrinsics", True, "on"),
        ("bake.b_frames", None, "automatic"),
    ],
)
def test_lists_and_mappings_are_typed_without_brackets(name: str, value: object, shown: str) -> None:
    field = next(field for field in fields_of(name.split(".")[0]) if field.name == name)
    assert field.shown(load_config(None, [(name, value)])) == shown
    assert field.parsed(shown) == value


def test_numbers_are_stepped_between_the_limits_of_their_settings() -> None:
    fields = {field.name: field for stage in SECTIONS for field in fields_of(stage)}
    assert (fields["train.sh_degree"].limits, fields["train.sh_degree"].whole) == ((0, 3), True)
    assert fields["train.dropout"].limits == (0, 1)
    assert fields["evaluate.crop_padding"].limits is None, "0 to 10,000"
    assert fields["train.max_splats"].limits is None
    steps = (("2", 1), ("2", -1), ("3", 1), ("0", -1))
    assert [fields["train.sh_degree"].stepped(*step) for step in steps] == ["3", "1", "3", "0"]
    dropout = fields["train.dropout"]
    steps = (("0.1", 1), ("0.1", -1), ("0.02", -1), ("0.98", 1), ("0.12", -1), ("0.13", 1), ("0.15", 1), ("0.15", -1))
    assert [dropout.stepped(*step) for step in steps] == ["0.15", "0.05", "0", "1", "0.1", "0.15", "0.2", "0.1"]
    ends = (("1", 1), ("1.0", 1), ("0.0", -1), ("0", -1))
    assert [dropout.stepped(*end) for end in ends] == ["1", "1.0", "0.0", "0"], "as it is written"
    text, lowered = "0.3", []
    for _ in range(6):
        text = fields["train.dilation"].stepped(text, -1) or ""
        lowered.append(text)
    assert lowered == ["0.25", "0.2", "0.15", "0.1", "0.05", "0.001"], "its range begins at 0.001"
    assert fields["train.dilation"].stepped("0.001", 1) == "0.05"
    assert dropout.stepped("a lot", 1) is None
    assert dropout.stepped("nan", 1) is None
    assert fields["train.max_splats"].stepped("1000", 1) is None


@pytest.mark.parametrize("typed", ["0 to 7", "0-7", "0:8"])
def test_frames_are_typed_as_in_the_dialog_of_a_new_take(typed: str) -> None:
    field = next(field for field in fields_of("capture") if field.name == "capture.frames")
    assert field.parsed(typed) == "0:8"


def test_no_value_is_told_in_the_word_of_its_setting() -> None:
    assert value_words("capture.frames", load_config(None, [])) == "all"
    (reason,) = differences({"capture.frames": None}, {"capture.frames": "2:30"})
    assert reason.words == "changed from all to 2:30"
