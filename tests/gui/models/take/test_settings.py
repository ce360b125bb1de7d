"""The settings in the left panel: headings, distinct labels, and the filter."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gui.models.take import setting_words
from gui.models.take.settings import SECTIONS, SettingField, fields_of, matching, place_of, stage_of
from pipelines.config import Config, load_config


@pytest.mark.parametrize("stage", SECTIONS)
def test_settings_stand_under_headings_with_labels_of_their_own(stage: str) -> None:
    fields = fields_of(stage)
    assert all(field.heading for field in fields)
    labels = [field.label for field in fields]
    assert len(set(labels)) == len(labels)
    runs = [heading for heading, _ in itertools.groupby(field.heading for field in fields)]
    assert len(set(runs)) == len(runs), "each heading once"


def test_the_filter_looks_at_names_headings_and_documentation() -> None:
    fields = fields_of("train")
    assert [field.name for field in matching(fields, "  ")] == [field.name for field in fields]
    rates = matching(fields, "learning rate splats")
    told = ("train.rates.", "train.finetune_rate_final")  # by their heading; by its documentation
    assert [field.name for field in rates] == [field.name for field in fields if field.name.startswith(told)]
    assert [field.name for field in matching(fields, "Quaternion")] == ["train.rates.rotation"]
    assert matching(fields, "quaternion nonsense") == []
    named = matching(fields_of("capture"), "capture.held_out")
    assert [field.name for field in named] == ["capture.held_out"]


OPTIONAL = [field for stage in SECTIONS for field in fields_of(stage) if field.nullable]
VALUES = {
    "evaluate.lpips": "vgg",  # Literal | None
    "calibrate.shared_intrinsics": False,  # bool | None
    "calibrate.frame": 3,  # int | None
    "calibrate.scale_distance": 0.5,  # float | None
    "capture.rig": "off",  # str | None, a word that YAML reads as false
}


def test_optional_settings_of_all_kinds_are_tried() -> None:
    assert {field.name for field in OPTIONAL} > set(VALUES)
    assert {field.kind for field in OPTIONAL} == {"choice", "text"}, "a checkbox has no third state"


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


@pytest.mark.parametrize("name", VALUES)
def test_a_value_of_an_optional_setting_survives_its_editor(name: str) -> None:
    field = next(field for field in OPTIONAL if field.name == name)
    config = load_config(None, [(name, VALUES[name])])
    shown = field.shown(config)
    assert field.kind == "text" or shown in field.choices
    assert field.parsed(shown) == VALUES[name]
    assert type(field.parsed(shown)) is type(VALUES[name])


CHOSEN = [field for stage in SECTIONS for field in fields_of(stage) if field.kind != "text"]


@pytest.mark.parametrize("field", CHOSEN, ids=lambda field: field.name)
def test_every_choice_is_a_value_that_is_shown_as_itself(field: SettingField) -> None:
    for word in field.choices or ("true", "false"):
        assert field.shown(load_config(None, [(field.name, field.parsed(word))])) == word


def test_letters_beyond_ascii_are_shown_as_they_are() -> None:
    held_out = next(field for field in fields_of("capture") if field.name == "capture.held_out")
    config = load_config(None, [("capture.held_out", ["caméra 1", "影"])])
    assert held_out.shown(config) == "caméra 1, 影"
    assert held_out.parsed(held_out.shown(config)) == ["caméra 1", "影"]
    assert held_out.parsed("[caméra 1, 影]") == ["caméra 1", "影"], "as in the file"


def test_words_units_and_choices_of_paths_belong_to_settings() -> None:
    fields = {field.name: field for stage in SECTIONS for field in fields_of(stage)}
    named = {*setting_words.EMPTY, *setting_words.UNITS, *setting_words.FOLDERS, *setting_words.FILES}
    assert named | setting_words.BASIC <= set(fields)
    assert fields["calibrate.board.square"].label == "board: square (m)"
    for name, field in fields.items():
        shown = field.shown(Config())
        assert shown not in ("null", "[]", "{}", "[", "{"), name
        if name != "capture.root":  # becomes absolute
            assert load_config(None, [(name, field.parsed(shown))]) == Config(), f"{name}: {shown!r}"


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("capture.offsets", {"cam1": 2, "cam2": -1}, "cam1: 2, cam2: -1"),
        ("capture.background", [0.0, 0.5, 1.0], "0.0, 0.5, 1.0"),
        ("capture.cameras", [], "all"),
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
    text, found = "0.3", []
    for _ in range(6):
        text = fields["train.dilation"].stepped(text, -1) or ""
        found.append(text)
    assert found == ["0.25", "0.2", "0.15", "0.1", "0.05", "0.001"], "its range begins at 0.001"
    assert fields["train.dilation"].stepped("0.001", 1) == "0.05"
    assert dropout.stepped("a lot", 1) is None
    assert dropout.stepped("nan", 1) is None
    assert fields["train.max_splats"].stepped("1000", 1) is None


def opened(open_window: Callable, take: Path, stage: str) -> Any:
    """A window on the take, paused, with a finished stage selected."""
    window = open_window(str(take))
    window.wait_for("a take", lambda s: s["stages"][stage][0] == "done")
    window.stage(stage)
    return window


def test_the_window_shows_that_nothing_is_chosen_and_lets_it_be_chosen_again(
    open_window: Callable, take_copy: Path, artifacts: Path
) -> None:
    window = opened(open_window, take_copy, "review")
    window.click("settings filter")
    window.enter_text("settings filter", "lpips")
    name = "setting evaluate.lpips"
    window.wait_for("one setting", lambda s: [n for n in s["widgets"] if n.startswith("setting ")] == [name])

    def choose(row: int) -> None:
        """The toolkit draws a list of choices right below its box; measured at its default font size."""
        window.click(name)
        window.ticks(20)  # the toolkit does not report when its list is open
        window.screenshot(artifacts / f"optional_setting_{row}.png")
        left, bottom = window.point(name, 0.3, 1.0)
        window.press(left, bottom + 9 + 20 * row)

    def lpips() -> str | None:
        return load_config(take_copy / "config.yaml").evaluate.lpips

    assert lpips() is None
    choose(1)
    window.wait_for("a stale evaluation", lambda s: s["stages"]["review"][0] != "done")
    assert lpips() == "alex"
    choose(0)
    window.wait_for("an evaluation that is up to date", lambda s: s["stages"]["review"][0] == "done")
    assert lpips() is None
    assert window.close() == 0, window.stderr.read_text()[-2000:]


def test_a_setting_is_found_and_changed_through_the_filter(
    open_window: Callable, take_copy: Path, artifacts: Path
) -> None:
    window = opened(open_window, take_copy, "train")
    state = window.wait_for("few settings", lambda s: "setting train.dropout" in s["widgets"])
    assert len([name for name in state["widgets"] if name.startswith("setting ")]) < 20
    window.click("settings filter")
    window.enter_text("settings filter", "rates opacity")
    state = window.wait_for("one setting", lambda s: [n for n in s["widgets"] if n.startswith("setting ")] == FOUND)
    assert state["stage"] == "train", "letters typed into the field are not shortcuts"
    window.screenshot(artifacts / "settings_filter.png")
    window.retype(FOUND[0], "0.025")
    window.key("Return")
    window.wait_for("a stale training", lambda s: s["stages"]["train"][0] != "done")
    assert load_config(take_copy / "config.yaml").train.rates.opacity == 0.025
    window.click("reset train.rates.opacity")
    window.wait_for("the usual value", lambda s: s["texts"][FOUND[0]] == "0.05" and s["stages"]["train"][0] == "done")
    window.chord("z")
    window.wait_for("the change", lambda s: s["texts"][FOUND[0]] == "0.025")
    window.chord("z", "Shift_L")
    window.wait_for("no change", lambda s: s["texts"][FOUND[0]] == "0.05")
    window.saw("a notice", lambda s: "Redone" in s["notice"])
    assert load_config(take_copy / "config.yaml").train.rates.opacity == 0.05
    before = window.states()[-1]["widgets"]["stages"][2]
    window.drag("stages", (0.99, 0.5), (1.25, 0.5))
    state = window.wait_for("a wider panel", lambda s: s["widgets"]["stages"][2] > before + 40)
    assert state["stage"] == "train", "dragging the edge selects no stage"
    window.screenshot(artifacts / "settings_wide.png")
    window.retype("settings filter", "")
    window.click("all settings", 0.2)
    window.wait_for("all of them", lambda s: len([n for n in s["widgets"] if n.startswith("setting ")]) > 40)
    assert window.close() == 0, window.stderr.read_text()[-2000:]


FOUND = ["setting train.rates.opacity"]


WITH_A_FOOTAGE_ERROR = """
import sys
from gui.models.take import workspace
from gui.models.stage_rows import Assessment
from studio.errors import Message

error = Message("footage.all_held_out", "all 6 cameras are held out", fix="Change it.", fields={"setting": SETTING})
workspace.assess = lambda context: Assessment(footage_error=error)
from gui.app import main
sys.exit(main())
"""


def test_the_window_leads_from_an_error_to_the_setting_that_fixes_it(
    open_window: Callable, take_copy: Path, artifacts: Path
) -> None:
    program = ("-c", WITH_A_FOOTAGE_ERROR.replace("SETTING", repr("capture.held_out"), 1))
    window = open_window(str(take_copy), program=program)
    window.wait_for("the error", lambda s: s["stages"]["capture"][0] == "failed")
    assert window.states()[-1]["error_setting"] == "", "the error is another stage's"
    window.stage("capture")
    state = window.wait_for("the button", lambda s: "error setting" in s["widgets"])
    assert state["error_setting"] == "capture.held_out"
    assert "all 6 cameras are held out. Change it." in state["stages"]["capture"][2]
    window.screenshot(artifacts / "setting_link.png")
    window.click("error setting")
    window.wait_for(
        "the setting alone",
        lambda s: [n for n in s["widgets"] if n.startswith("setting ")] == ["setting capture.held_out"],
    )
    assert window.states()[-1]["texts"]["settings filter"] == "capture.held_out"
    window.screenshot(artifacts / "setting_link_followed.png")
    assert window.close() == 0, window.stderr.read_text()[-2000:]


def test_every_setting_has_a_stage() -> None:
    assert stage_of("capture.held_out") == "capture"
    assert stage_of("evaluate.lpips") == "review"
    assert stage_of("no.such") == ""
    assert stage_of("") == ""


def test_a_dialog_begins_where_the_file_is_on_this_machine(tmp_path: Path) -> None:
    here = tmp_path / "mounted" / "day1"
    (here / "sound").mkdir(parents=True)
    (here / "sound" / "a.wav").touch()
    audio, root = (next(f for f in fields_of("capture") if f.name == f"capture.{name}") for name in ("audio", "root"))
    there: list[tuple[str, Any]] = [
        ("capture.root", "/studio/day1"),
        ("run.paths", {"/studio": [str(tmp_path / "mounted")]}),
    ]
    mounted = load_config(None, there)
    assert place_of(root, mounted) == here
    assert place_of(audio, mounted) == here
    assert place_of(audio, load_config(None, [*there, ("capture.audio", "sound/a.wav")])) == here / "sound" / "a.wav"
    assert place_of(audio, load_config(None, [("capture.root", "s3://studio/day1")])) == Path.home()
    assert place_of(root, load_config(None, [("capture.root", "/studio/day1")])) == Path.home()
