"""Settings in the window, with what they make stale; help, fixes of warnings, marks and spans."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.gui.conftest import RunningWindow, State
from v3studio.pipelines.config.loading import load_config
from v3studio.pipelines.events import Warned
from v3studio.pipelines.takes.files.settings_file import save_config
from v3studio.pipelines.takes.results.evaluation import read_evaluation
from v3studio.pipelines.takes.take import Take

ARGUMENTS = ("--size", "1280x800")  # the log needs room for its buttons

OPACITY = "setting train.rates.opacity"
FIX, SWITCH = "Set 'scale of images' in Capture to 0.5", "warnings only (1)"


@pytest.fixture(scope="module")
def take(take: Path) -> Path:
    """The take of the file, with a warning in its log that a setting fixes."""
    fields = {"setting": "capture.scale", "suggested": 0.5}
    warning = Warned(stage="train", message="training is slow", code="training.slow", fields=fields)
    with Take(take).log.open("a", encoding="utf-8") as log:
        log.write(warning.to_json() + "\n")
    return take


def settings_on_screen(state: State) -> list[str]:
    return [name for name in state["widgets"] if name.startswith("setting ")]


def trained(state: State) -> bool:
    return bool(state["stages"]["train"][0] == "done")


@pytest.fixture
def opacity(window: RunningWindow) -> RunningWindow:
    """The window with one setting of Train, found by its name."""
    window.stage("train")
    window.retype("settings filter", "rates opacity")
    state = window.wait_for("one setting", lambda s: settings_on_screen(s) == [OPACITY])
    assert state["stage"] == "train", "letters typed into the field are not shortcuts"
    window.wait_for("the field", lambda s: s["widgets"][OPACITY][2] > 0)
    return window


def test_help_shows_a_setting(window: RunningWindow) -> None:
    setting = "dialog setting train.max_splats"
    window.stage("train")
    window.key("F1", until=("help", lambda s: s["dialog"] == "help" and setting in s["widgets"]))
    window.key("Escape", until=("no help", lambda s: not s["dialog"]))
    window.key("question", until=("the shortcuts", lambda s: s["dialog"] == "message"))
    window.key("Escape", until=("no shortcuts", lambda s: not s["dialog"]))
    window.click("help", until=("help again", lambda s: s["dialog"] == "help"))
    window.click(setting)
    window.wait_for("the setting", lambda s: not s["dialog"] and "setting train.max_splats" in s["widgets"])


def test_a_warning_is_fixed_in_the_log(window: RunningWindow, take: Path) -> None:
    config = Take(take).config
    before = load_config(config).capture.scale
    assert before != 0.5
    window.choose("log", SWITCH, until=("warnings only", lambda s: "all lines" in s["parts"]["log"]))
    # the only line of the log moves to its top
    window.wait_for("the button", lambda s: FIX in s["parts"]["log"] and s["parts"]["log"][FIX][1] < 0.5)
    window.choose("log", FIX)
    fixed = "'scale of images' in Capture is 0.5 now"
    window.wait_for("another button", lambda s: fixed in s["parts"]["log"] and s["stage"] == "capture")
    assert load_config(config).capture.scale == 0.5
    window.chord("z", until=("the button again", lambda s: FIX in s["parts"]["log"]))
    assert load_config(config).capture.scale == before


def test_the_worst_frame_is_compared_with_its_footage(window: RunningWindow, take: Path) -> None:
    rows = read_evaluation(Take(take).evaluation).frames
    value, worst, camera = min((q.psnr_decoded, row.index, name) for row in rows for name, q in row.cameras.items())
    window.menu("View", "worst", until=("the worst frames", lambda s: s["dialog"] == "worst"))
    window.send("mousemove", *window.point("dialog sheet", *window.part("dialog sheet", f"{camera} {worst}")))
    window.send("mousedown", 1)
    assert window.states()[-1]["dialog"] == "worst", "the toolkit crashes if a widget goes while it is pressed"
    window.send("mouseup", 1)
    shown = window.wait_for(f"{value} dB", lambda s: (s["stage"], s["camera"], s["shown"]) == ("review", camera, worst))
    assert shown["compare"] == "side by side"


def test_a_span_is_dragged_and_left_with_escape(window: RunningWindow) -> None:
    window.select_span(0, window.states()[-1]["frames"] - 1)
    window.key("Escape", until=("no span", lambda s: s["span"] is None))


def test_a_refused_setting_moves_no_field_and_letters_stay_with_it(opacity: RunningWindow) -> None:
    place = opacity.states()[-1]["widgets"][OPACITY]
    opacity.retype(OPACITY, "nope")
    state = opacity.key("Return", until=("a refusal", lambda s: "train.rates.opacity" in s["error"]))
    assert state["widgets"][OPACITY] == place, "fields stay where they are when a message appears"
    x, y = opacity.point(OPACITY)
    opacity.press(x, y + 120)  # below it, where no field has the focus
    opacity.key("w")
    assert opacity.wait_for("a look", lambda s: s["settled"])["stage"] == "train", "a letter may be meant for a field"


def test_a_setting_is_changed_reset_undone_and_redone(opacity: RunningWindow, take: Path) -> None:
    def written() -> float:
        return load_config(take / "config.yaml").train.rates.opacity

    opacity.retype(OPACITY, "0.025")
    opacity.key("Return", until=("a stale training", lambda s: not trained(s)))
    assert written() == 0.025
    opacity.click("reset train.rates.opacity")
    opacity.wait_for("the usual value", lambda s: s["texts"][OPACITY] == "0.05" and trained(s))
    opacity.chord("z", until=("the change", lambda s: s["texts"][OPACITY] == "0.025"))
    undone = "Undone: the change of 'rates: opacity' in Train from 0.025 to 0.05."
    opacity.saw("what was undone", lambda s: s["notice"] == undone)
    opacity.chord("z", "Shift_L", until=("no change", lambda s: s["texts"][OPACITY] == "0.05"))
    opacity.saw("a notice", lambda s: "Redone" in s["notice"])
    assert written() == 0.05


@pytest.fixture
def written(window: RunningWindow, take: Path) -> Iterator[Callable[..., None]]:
    """Writes settings, as another program does; after the test, they are as they were."""
    config = Take(take).config
    before = config.read_text()
    yield lambda *settings: save_config(config, load_config(config, list(settings)))
    config.write_text(before)
    window.wait_for("the results", trained)


def test_one_change_is_one_reason_of_the_stages_after_it(window: RunningWindow, written: Callable[..., None]) -> None:
    written(("train.max_splats", 300))
    rows = window.wait_for("a stale bake", lambda s: s["stages"]["bake"][0] == "stale")["stages"]
    assert rows["train"][2] == "'most splats' in Train changed from 400 to 300"
    assert rows["bake"][2].startswith("Run also runs Train.")
    assert rows["review"][2].startswith("Run also runs Train and Bake.")


def test_a_marked_frame_stays_that_of_the_footage(window: RunningWindow, written: Callable[..., None]) -> None:
    question = ("a question", lambda s: s["dialog"] == "mark" and s["typing"])
    window.send("key", "Home", "Right", "Right", "m", until=question)
    window.key("Return", until=("the mark", lambda s: list(s["marks"]) == ["2"] and not s["dialog"]))
    written(("capture.frames", "1:5"))
    window.stage("capture")
    window.wait_for("fewer frames", lambda s: s["frames"] == 4 and s["upcoming"] == "all")
    for key, number in (("Home", 1), ("period", 2)):
        window.key(key)
        window.wait_for(f"frame {number}", lambda s, number=number: (s["number"], s["frame"]) == (number, number - 1))
    window.stage("review")
    window.key("Home")
    window.key("period", until=("the marked frame", lambda s: s["number"] == 2 and s["shown"] == 2 and s["settled"]))
    window.chord("z", until=("no mark", lambda s: not s["marks"]))


def test_why_presets_have_no_estimate_is_told(window: RunningWindow, take: Path, written: Callable[..., None]) -> None:
    rig = Take(take).rig
    window.stage("train")
    written(("capture.rig", None))
    window.wait_for("no camera file", lambda s: "not from the camera file" in s["stages"]["calibrate"][2])
    cameras = rig.rename(take / "rig.json")
    window.wait_for("no cameras", lambda s: "was deleted" in s["stages"]["calibrate"][2])
    window.click("estimate", until=("a refusal", lambda s: "the cameras are not known yet" in s["error"]))
    cameras.rename(rig)
    window.wait_for("no refusal", lambda s: s["error"] == "")


def test_the_left_panel_is_dragged_wider_and_shows_all_settings(window: RunningWindow) -> None:
    window.stage("train")
    before = window.states()[-1]["widgets"]["stages"][2]
    window.drag("stages", (0.99, 0.5), (1.25, 0.5))
    state = window.wait_for("a wider panel", lambda s: s["widgets"]["stages"][2] > before + 40)
    assert state["stage"] == "train", "dragging the edge selects no stage"
    window.retype("settings filter", "")
    window.wait_for("few settings", lambda s: 3 < len(settings_on_screen(s)) < 20)
    window.click("all settings", 0.2, until=("all of them", lambda s: len(settings_on_screen(s)) > 40))


def test_figures_of_an_earlier_bake_say_so(window: RunningWindow) -> None:
    def earlier(state: State) -> set[bool]:
        return {"earlier bake" in name for name in state["plots"] if "PSNR" in name}

    window.stage("bake")
    window.retype("setting bake.quality", "26")
    window.key("Return", until=("a stale bake", lambda s: s["stages"]["bake"][0] == "stale" and earlier(s) == {True}))
    window.click("run")
    window.saw("a run", lambda s: s["busy"])
    state = window.wait_for("another bake", lambda s: s["stages"]["bake"][0] == "done" and not s["busy"], 600)
    assert state["stages"]["review"][0] == "stale"
    window.wait_for("figures of the bake before", lambda s: earlier(s) == {True})
