"""Edits, the scene, cameras, points, comparisons and marks in the window: by mouse, keyboard and undo."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.gui.conftest import SIZE, RunningWindow, State, assert_apart
from tests.support.waiting import wait_until
from v3studio.gui.drawing.palette import FAIR
from v3studio.pipelines.config import load_config
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.studio.calibration import read_tie_points
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.edits import EditList


def capture(take: Path) -> CaptureSettings:
    return load_config(take / "config.yaml").capture


def box_pixels(window: RunningWindow) -> int:
    """Pixels of the viewport in the color of the box around the visual hull."""
    return int((np.abs(window.pixels("viewport").astype(int) - FAIR) < 30).all(axis=2).sum())


def bright(window: RunningWindow) -> int:
    """Number of bright pixels in the lower left of the view, where nobody stands."""
    pixels = window.pixels("viewport")
    height, width, _ = pixels.shape
    return int((pixels[height - height // 2 :, : width // 3].mean(axis=2) > 150).sum())


def in_scene(state: State) -> bool:
    return bool(state["compare"] == "scene" and state["settled"] and state["parts"]["viewport"])


@pytest.fixture
def editing(window: RunningWindow) -> Iterator[RunningWindow]:
    """The window with the edits on screen."""
    window.key("Home")
    window.key("x", until=("the edits", lambda s: "orbit" in s["mode"] and "lasso" in s["widgets"] and s["settled"]))
    yield window
    window.click("orbit", until=("no tool", lambda s: "orbit" in s["mode"]))
    window.key("Escape", until=("the take", lambda s: "decoded" in s["mode"]))


@pytest.fixture
def scene(window: RunningWindow) -> Iterator[RunningWindow]:
    """The window with the scene on screen."""
    window.key("Home")
    window.key("o", until=("the scene", lambda s: in_scene(s) and "+x" in s["parts"]["viewport"]))
    yield window
    window.key("Escape", until=("the take", lambda s: s["compare"] == "single"))


def test_the_brush_follows_the_pointer_in_its_size(editing: RunningWindow) -> None:
    editing.click("brush", until=("the brush", lambda s: "brush" in s["mode"]))
    tops = {editing.states()[-1]["widgets"][name][1] for name in ("done", "brush", "remove", "removed")}
    assert len(tops) <= 3, "all buttons have words, in three rows at most"
    before = bright(editing)
    editing.send("mousemove", *editing.point("viewport", 0.2, 0.7))
    wait_until("a circle", lambda: bright(editing) > before)
    small = bright(editing)
    editing.key("plus")
    wait_until("a larger circle", lambda: bright(editing) > small)
    editing.key("minus")


def test_a_selection_is_removed_from_a_group(editing: RunningWindow, take: Path) -> None:
    editing.click("brush", until=("the brush", lambda s: "brush" in s["mode"]))
    editing.select_span(1, 3)
    editing.key("Home", until=("the first frame", lambda s: s["shown"] == 0 and s["settled"]))
    editing.drag("viewport", (0.45, 0.5), (0.55, 0.5), until=("some", lambda s: s["selected"] > 0 and s["settled"]))
    editing.click("remove", until=("counts", lambda s: s["dialog"] == "remove" and len(s["lines"]) == 3))
    editing.click("dialog choice0", until=("it to be removed", lambda s: "regions 1" in s["edits"] and not s["dialog"]))
    (region,) = read_edits(take / "edits.json").regions
    assert region.radius is not None
    assert region.frames == (0, 0)
    editing.wait_for("one group to bake", lambda s: s["stages"]["bake"][0] == "partial")
    editing.chord("z", until=("no edits", lambda s: s["edits"] == {} and s["stages"]["bake"][0] == "done"))
    assert read_edits(take / "edits.json") == EditList()
    editing.key("t")  # after the end of the span, no span
    editing.wait_for("no span", lambda s: s["span"] is None)


def test_a_detail_has_a_radius_and_is_trained_again(editing: RunningWindow) -> None:
    editing.click("detail", until=("the tool", lambda s: "detail" in s["mode"] and s["settled"]))
    editing.click("viewport")
    editing.wait_for("training to do again", lambda s: "details 1" in s["edits"] and s["stages"]["train"][0] != "done")
    editing.wait_for("a picture of it", lambda s: s["settled"])
    editing.click("numbers", until=("typing", lambda s: s["dialog"] == "numbers" and s["typing"]))
    editing.key("1", until=("a radius", lambda s: s["texts"]["dialog radius"] == "1"))
    editing.key("Return", until=("the radius", lambda s: not s["dialog"] and "radius 1," in s["edits"]["details 1"]))
    editing.chord("z")
    editing.chord("z", until=("no detail", lambda s: s["edits"] == {} and s["stages"]["train"][0] == "done"))


def test_the_scene_is_turned_and_stays_while_another_stage_is_shown(scene: RunningWindow) -> None:
    orbit = scene.states()[-1]["orbit"]
    scene.drag("viewport", (0.5, 0.8), (0.65, 0.7), until=("turned", lambda s: s["orbit"] != orbit and s["settled"]))
    scene.stage("calibrate")
    scene.stage("review")
    scene.wait_for("the scene again", in_scene)
    scene.stage("calibrate")
    scene.key("o", until=("the scene again", in_scene))
    scene.choose("viewport", "+z", until=("from above", lambda s: abs(s["orbit"][1]) > 1.5 and s["settled"]))


def test_the_scene_has_a_box_and_plays(scene: RunningWindow) -> None:
    wait_until("the box", lambda: box_pixels(scene) > 200)
    scene.key("End", until=("the last frame", lambda s: s["shown"] == s["frames"] - 1 and s["settled"]))
    at = scene.key("space", until=("playing", lambda s: s["playing"]))["pictures"]
    scene.wait_for("more pictures", lambda s: s["pictures"] > at + 5)
    scene.key("space", until=("paused", lambda s: not s["playing"] and s["settled"]))
    scene.drawn()
    with_box = box_pixels(scene)
    scene.click("volume", until=("no box", lambda s: "volume" not in s["mode"] and s["settled"]))
    wait_until("no box on the screen", lambda: box_pixels(scene) < 0.5 * with_box)
    scene.click("volume", until=("the box", lambda s: "volume" in s["mode"] and s["settled"]))


def test_uses_of_cameras_are_chosen_in_a_list(window: RunningWindow, take: Path) -> None:
    uses = capture(take)
    window.stage("capture")
    menu = ("its menu", lambda s: s["menu_camera"] == "cam0" and "camera list" in s["widgets"])
    window.choose("viewport", "cam0", 3, menu)
    window.click("camera list", until=("the list", lambda s: s["dialog"] == "cameras"))
    window.click("dialog hold out cam1", 0.2)
    window.click("dialog use cam0")
    window.click("dialog save", until=("staleness", lambda s: s["dialog"] == "" and s["stages"]["train"][0] != "done"))
    assert capture(take).cameras == ("cam1", "cam2", "cam3", "cam4", "cam5")
    assert capture(take).held_out == ("cam1", "cam4")
    window.chord("z", until=("the results", lambda s: s["stages"]["train"][0] == "done"))
    assert capture(take) == uses


def test_one_camera_is_shown_alone_and_held_out(window: RunningWindow, take: Path) -> None:
    window.stage("capture")
    alone = ("one", lambda s: s["alone"] == "cam2" and s["settled"] and list(s["parts"]["viewport"]) == ["cam2"])
    window.choose("viewport", "cam2", until=alone)
    window.key("Escape", until=("all cameras", lambda s: s["alone"] == "" and len(s["parts"]["viewport"]) == 6))
    menu = ("its menu", lambda s: s["menu_camera"] == "cam2" and "camera held out" in s["widgets"])
    assert "camera training" not in window.choose("viewport", "cam2", 3, menu)["widgets"]
    window.click("camera held out")
    window.wait_for("stale results", lambda s: s["menu_camera"] == "" and s["stages"]["train"][0] != "done")
    assert capture(take).held_out == ("cam2", "cam4")
    window.chord("z", until=("the results", lambda s: s["stages"]["train"][0] == "done"))


def test_errors_of_a_camera_are_copied_and_its_view_is_shown(window: RunningWindow) -> None:
    window.stage("calibrate")
    state = window.wait_for("frustums", lambda s: s["settled"] and len(s["parts"]["viewport"]) > 2)
    nearest = list(state["parts"]["viewport"])[-1]
    menu = ("its menu", lambda s: s["menu_camera"] == nearest and "camera errors" in s["widgets"])
    window.choose("viewport", nearest, 3, menu)
    window.click("camera errors", until=("the report", lambda s: "report" in s["mode"] and s["settled"]))
    window.chord("c")
    window.saw("the table on the clipboard", lambda s: "Copied the table" in s["notice"])
    window.click("cameras", until=("the cameras", lambda s: "cameras" in s["mode"] and s["settled"]))
    view = ("Review", lambda s: s["stage"] == "review" and s["camera"] == nearest and s["settled"])
    window.choose("viewport", nearest, until=view)


def test_points_are_marked_and_named_by_hand(window: RunningWindow, take: Path) -> None:
    file = take / "points.yaml"
    window.stage("calibrate")
    window.click("points by hand", until=("the view", lambda s: s["mode"] == ["points by hand"] and s["settled"]))
    window.click("viewport", 0.6, 0.5)
    wait_until("a point in the file", file.is_file)
    pictures = window.states()[-1]["pictures"]
    window.key("c", until=("the next camera", lambda s: s["pictures"] > pictures and s["settled"]))
    window.click("viewport", 0.6, 0.55)
    wait_until("two marks of one point in the file", lambda: [len(p.pixels) for p in read_tie_points(file)] == [2])
    window.key("e", until=("the dialog", lambda s: s["dialog"] == "numbers" and s["typing"]))
    window.enter_text("dialog name", "corner", selected=True)
    window.retype("dialog place", "0 0 1")
    window.key("Return", until=("no dialog", lambda s: not s["dialog"]))
    (point,) = read_tie_points(file)
    assert (point.name, point.world) == ("corner", (0, 0, 1))


def test_the_line_of_a_wipe_is_dragged_and_turns_nothing(window: RunningWindow) -> None:
    window.key("3")
    window.key("Home")
    first = window.key("w", until=("a wipe", lambda s: s["compare"] == "wipe" and s["settled"]))["camera"]
    other = ("another camera", lambda s: s["camera"] not in ("", first) and s["settled"] and s["shown"] == 0)
    before = window.key("c", until=other)
    line = ("a moved line", lambda s: abs(s["wipe"] - 0.3) < 0.05 and s["settled"])
    moved = window.drag("viewport", (before["wipe"], 0.6), (0.3, 0.6), until=line)
    assert moved["camera"] == before["camera"]
    window.key("d", until=("the difference", lambda s: s["compare"] == "difference" and s["settled"]))


def test_escape_leaves_fullscreen_and_no_panels_overlap(window: RunningWindow) -> None:
    full = window.key("f", until=("fullscreen", lambda s: s["fullscreen"] and s["widgets"]["viewport"][2] > 1000))
    assert full["widgets"]["viewport"][3] > 700
    window.key("Escape")
    window.wait_for("the panels again", lambda s: not s["fullscreen"] and s["widgets"]["viewport"][2] < 800)
    assert window.process.poll() is None, "Escape does not close the window"
    assert_apart(window, *map(int, SIZE.split("x")))
