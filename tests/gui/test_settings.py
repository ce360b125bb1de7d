"""Settings, help, fixes of warnings and spans in the window."""

from collections.abc import Callable
from pathlib import Path

from tests.gui.conftest import RunningWindow
from v3studio.pipelines.config.loading import load_config
from v3studio.pipelines.events import Warned
from v3studio.pipelines.takes.files.settings_file import save_config
from v3studio.pipelines.takes.results.evaluation import read_evaluation
from v3studio.pipelines.takes.take import Take

FOUND = ["setting train.rates.opacity"]


def test_settings_help_a_fix_and_a_span(open_window: Callable[..., RunningWindow], take_copy: Path) -> None:
    take = Take(take_copy)
    warning = Warned(
        stage="train",
        message="training is slow",
        code="training.slow",
        fields={"setting": "capture.scale", "suggested": 0.5},
    )
    with take.log.open("a", encoding="utf-8") as log:
        log.write(warning.to_json() + "\n")
    before = load_config(take.config).capture.scale
    assert before != 0.5
    window = open_window(str(take_copy), "--size", "1280x800")
    window.wait_for("the take", lambda s: s["frames"] > 1 and s["shown"] is not None and not s["opening"])

    window.stage("train")
    window.key("F1")
    window.wait_for("help", lambda s: s["dialog"] == "help" and "dialog setting train.max_splats" in s["widgets"])
    window.key("Escape", until=("no help", lambda s: not s["dialog"]))
    window.click("help", until=("help again", lambda s: s["dialog"] == "help"))
    window.click("dialog setting train.max_splats")
    window.wait_for("the setting", lambda s: not s["dialog"] and "setting train.max_splats" in s["widgets"])

    words = "Set 'scale of images' in Capture to 0.5"
    switch = "warnings only (1)"
    fixes = window.wait_for("the switch", lambda s: switch in s["fixes"])["fixes"]
    window.click("log", *fixes[switch], until=("warnings only", lambda s: "all lines" in s["fixes"]))
    # the only line of the log moves to its top
    fixes = window.wait_for("the button", lambda s: words in s["fixes"] and s["fixes"][words][1] < 0.5)["fixes"]
    window.click("log", *fixes[words])
    window.wait_for(
        "another button", lambda s: "'scale of images' in Capture is 0.5 now" in s["fixes"] and s["stage"] == "capture"
    )
    assert load_config(take.config).capture.scale == 0.5
    window.chord("z", until=("the button again", lambda s: words in s["fixes"]))
    assert load_config(take.config).capture.scale == before

    window.menu("View", "worst", until=("the worst frames", lambda s: s["dialog"] == "worst"))
    window.send("mousemove", *window.point("dialog sheet", 0.05, 0.1))
    window.send("mousedown", 1)
    assert window.states()[-1]["dialog"] == "worst", "the toolkit crashes if a widget goes while it is pressed"
    window.send("mouseup", 1)
    rows = read_evaluation(take.evaluation).frames
    value, worst, camera = min((q.psnr_decoded, row.index, name) for row in rows for name, q in row.cameras.items())
    window.wait_for(f"{value} dB", lambda s: (s["stage"], s["camera"], s["shown"]) == ("review", camera, worst))
    assert window.states()[-1]["compare"] == "side by side"
    frames = window.states()[-1]["frames"]
    window.drag("timeline", (window.across_frame(0), 0.1), (window.across_frame(frames - 1), 0.1))
    window.wait_for("a span", lambda s: s["span"] == [0, frames - 1])
    window.key("Escape", until=("no span", lambda s: s["span"] is None))

    window.stage("train")
    window.retype("settings filter", "")
    state = window.wait_for("few settings", lambda s: "setting train.group_size" in s["widgets"])
    assert len([name for name in state["widgets"] if name.startswith("setting ")]) < 20
    window.click("settings filter")
    window.enter_text("settings filter", "rates opacity")
    state = window.wait_for("one setting", lambda s: [n for n in s["widgets"] if n.startswith("setting ")] == FOUND)
    assert state["stage"] == "train", "letters typed into the field are not shortcuts"
    place = window.wait_for("the field", lambda s: s["widgets"][FOUND[0]][2] > 0)["widgets"][FOUND[0]]
    window.retype(FOUND[0], "nope")
    state = window.key("Return", until=("a refusal", lambda s: "train.rates.opacity" in s["error"]))
    assert state["widgets"][FOUND[0]] == place, "fields stay where they are when a message appears"
    x, y = window.point(FOUND[0])
    window.press(x, y + 120)  # below it, where no field has the focus
    window.key("w")
    assert window.wait_for("a look", lambda s: s["settled"])["stage"] == "train", "a letter may be meant for a field"
    window.retype(FOUND[0], "0.025")
    window.key("Return", until=("a stale training", lambda s: s["stages"]["train"][0] != "done"))
    assert load_config(take.root / "config.yaml").train.rates.opacity == 0.025
    window.click("reset train.rates.opacity")
    window.wait_for("the usual value", lambda s: s["texts"][FOUND[0]] == "0.05" and s["stages"]["train"][0] == "done")
    window.chord("z", until=("the change", lambda s: s["texts"][FOUND[0]] == "0.025"))
    undone = "Undone: the change of 'rates: opacity' in Train from 0.025 to 0.05."
    window.saw("what was undone", lambda s: s["notice"] == undone)
    window.chord("z", "Shift_L", until=("no change", lambda s: s["texts"][FOUND[0]] == "0.05"))
    window.saw("a notice", lambda s: "Redone" in s["notice"])
    assert load_config(take.root / "config.yaml").train.rates.opacity == 0.05

    # one change is one reason, in the words of the pages; a marked frame stays that of the footage
    window.stage("review")
    window.send(
        "key", "Home", "Right", "Right", "m", until=("a question", lambda s: s["dialog"] == "mark" and s["typing"])
    )
    window.key("Return", until=("the mark", lambda s: list(s["marks"]) == ["2"] and not s["dialog"]))
    config = load_config(take.config, [("train.max_splats", 300)])
    save_config(take.config, config)
    rows = window.wait_for("a stale bake", lambda s: s["stages"]["bake"][0] == "stale")["stages"]
    assert rows["train"][2] == "'most splats' in Train changed from 400 to 300"
    assert rows["bake"][2].startswith("Run also runs Train.")
    assert rows["review"][2].startswith("Run also runs Train and Bake.")
    save_config(take.config, load_config(take.config, [("capture.frames", "1:5"), ("train.max_splats", 400)]))
    window.stage("capture")
    window.wait_for("fewer frames", lambda s: s["frames"] == 4 and s["upcoming"] == "all")
    for key, number in (("Home", 1), ("period", 2)):
        window.key(key)
        window.wait_for(f"frame {number}", lambda s, number=number: (s["number"], s["frame"]) == (number, number - 1))
    window.stage("review")
    window.key("Home")
    window.key("period", until=("the marked frame", lambda s: s["number"] == 2 and s["shown"] == 2 and s["settled"]))
    window.stage("train")

    # why presets cannot be estimated is told until it is over
    save_config(take.config, load_config(take.config, [("capture.rig", None)]))
    window.wait_for("no camera file", lambda s: "not from the camera file" in s["stages"]["calibrate"][2])
    cameras = take.rig.rename(take.root / "rig.json")
    window.wait_for("no cameras", lambda s: "was deleted" in s["stages"]["calibrate"][2])
    window.click("estimate", until=("a refusal", lambda s: "the cameras are not known yet" in s["error"]))
    cameras.rename(take.rig)
    window.wait_for("no refusal", lambda s: s["error"] == "")
    before = window.states()[-1]["widgets"]["stages"][2]
    window.drag("stages", (0.99, 0.5), (1.25, 0.5))
    state = window.wait_for("a wider panel", lambda s: s["widgets"]["stages"][2] > before + 40)
    assert state["stage"] == "train", "dragging the edge selects no stage"
    window.retype("settings filter", "")
    window.click("all settings", 0.2)
    window.wait_for("all of them", lambda s: len([n for n in s["widgets"] if n.startswith("setting ")]) > 40)
    assert window.close() == 0, window.stderr.read_text()[-2000:]
