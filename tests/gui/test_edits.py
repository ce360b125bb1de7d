"""Edits, the scene, cameras and points in the window: tools by mouse, numbers and undo by keyboard."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.gui.conftest import RunningWindow, State, Until
from tests.support.waiting import wait_until
from v3studio.gui.drawing.palette import FAIR
from v3studio.pipelines.config import load_config
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.studio.calibration import read_tie_points
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.edits import EditList


def press(window: RunningWindow, camera: str, button: int, until: Until) -> State:
    """Click what shows a camera."""
    state = window.wait_for(f"a place of {camera}", lambda s: s["settled"] and camera in s["places"])
    place = window.point("viewport", *state["places"][camera])
    return window.send("mousemove", *place, "mousedown", button, "mouseup", button, until=until)


def box_pixels(window: RunningWindow) -> int:
    """Pixels of the viewport in the color of the box around the visual hull."""
    return int((np.abs(window.pixels("viewport").astype(int) - FAIR) < 30).all(axis=2).sum())


def bright(window: RunningWindow) -> int:
    """Number of bright pixels in the lower left of the view, where nobody stands."""
    pixels = window.pixels("viewport")
    height, width, _ = pixels.shape
    return int((pixels[height - height // 2 :, : width // 3].mean(axis=2) > 150).sum())


def test_edits_the_scene_cameras_and_points(open_window: Callable[..., RunningWindow], take_copy: Path) -> None:
    def capture() -> CaptureSettings:
        return load_config(take_copy / "config.yaml").capture

    uses = capture()
    window = open_window(str(take_copy))
    window.wait_for("a take", lambda s: s["stages"]["review"][0] == "done" and s["shown"] is not None)
    window.key("Home")
    window.key("x", until=("the edits", lambda s: "orbit" in s["mode"] and "lasso" in s["widgets"] and s["settled"]))
    window.click("brush", until=("the brush", lambda s: "brush" in s["mode"]))
    tops = {window.states()[-1]["widgets"][name][1] for name in ("done", "brush", "remove", "removed")}
    assert len(tops) <= 3, "all buttons have words, in three rows at most"
    before = bright(window)
    window.send("mousemove", *window.point("viewport", 0.2, 0.7))
    wait_until("a circle", lambda: bright(window) > before)
    small = bright(window)
    window.key("plus")
    wait_until("a larger circle", lambda: bright(window) > small)
    window.key("minus")
    window.drag("timeline", (window.across_frame(1), 0.1), (window.across_frame(3), 0.1))
    window.key("Home", until=("a span", lambda s: s["span"] == [1, 3] and s["shown"] == 0 and s["settled"]))
    window.drag("viewport", (0.45, 0.5), (0.55, 0.5))
    window.wait_for("a selection", lambda s: s["selected"] > 0 and s["settled"])
    window.click("remove")
    window.wait_for("counts", lambda s: s["dialog"] == "remove" and len(s["lines"]) == 3)
    window.click("dialog choice0")
    window.wait_for("it to be removed", lambda s: "regions 1" in s["edits"] and not s["dialog"])
    (region,) = read_edits(take_copy / "edits.json").regions
    assert region.radius is not None
    assert region.frames == (0, 0)
    window.wait_for("one group to bake", lambda s: s["stages"]["bake"][0] == "partial")
    window.chord("z", until=("no edits", lambda s: s["edits"] == {} and s["settled"]))
    window.click("orbit", until=("no tool", lambda s: "orbit" in s["mode"]))
    window.click("numbers", until=("kinds", lambda s: s["dialog"] == "edit kinds"))
    state = window.click("dialog choice1", until=("typing", lambda s: s["dialog"] == "numbers" and s["typing"]))
    assert state["widgets"]["dialog height"][2] >= 16 * 16, "16 em: three numbers can be read"
    window.enter_text("dialog height", "0.1")
    window.key("Return", until=("a ground", lambda s: s["dialog"] == "" and "ground" in s["edits"]))
    window.chord("z", until=("no edits", lambda s: s["edits"] == {} and s["stages"]["bake"][0] == "done"))
    assert read_edits(take_copy / "edits.json") == EditList()
    window.click("detail", until=("the tool", lambda s: "detail" in s["mode"] and s["settled"]))
    window.drag("viewport", (0.5, 0.5), (0.5, 0.5))
    window.wait_for("training to do again", lambda s: "details 1" in s["edits"] and s["stages"]["train"][0] != "done")
    window.wait_for("a picture of it", lambda s: s["settled"])
    window.click("numbers", until=("typing", lambda s: s["dialog"] == "numbers" and s["typing"]))
    window.key("1", until=("a radius", lambda s: s["texts"]["dialog radius"] == "1"))
    window.key("Return", until=("the radius", lambda s: s["dialog"] == "" and "radius 1," in s["edits"]["details 1"]))
    window.chord("z")
    window.chord("z", until=("no detail", lambda s: s["edits"] == {} and s["stages"]["train"][0] == "done"))
    window.key("Escape", until=("the take", lambda s: "decoded" in s["mode"]))

    # the scene
    window.key("Home")
    window.key("o")
    state = window.wait_for("the scene", lambda s: s["compare"] == "scene" and s["settled"] and "+x" in s["places"])
    assert "volume" in state["mode"]
    orbit = state["orbit"]
    window.drag("viewport", (0.5, 0.8), (0.65, 0.7), until=("turned", lambda s: s["orbit"] != orbit and s["settled"]))
    window.stage("calibrate")
    window.stage("review")
    window.wait_for("the scene again", lambda s: s["compare"] == "scene" and s["settled"] and s["places"])
    window.stage("calibrate")
    window.key("o", until=("the scene again", lambda s: s["compare"] == "scene" and s["settled"] and s["places"]))
    wait_until("the box", lambda: box_pixels(window) > 200)
    window.key("End", until=("the last frame", lambda s: s["shown"] == s["frames"] - 1 and s["settled"]))
    at = window.key("space", until=("playing", lambda s: s["playing"]))["pictures"]
    window.wait_for("more pictures", lambda s: s["pictures"] > at + 5)
    window.key("space", until=("paused", lambda s: not s["playing"] and s["settled"]))
    window.drawn()
    with_box = box_pixels(window)
    window.click("volume", until=("no box", lambda s: "volume" not in s["mode"] and s["settled"]))
    # what is on the screen follows what is known
    wait_until("no box on it", lambda: box_pixels(window) < 0.5 * with_box)
    across, down = window.states()[-1]["places"]["+z"]
    window.click("viewport", across, down, until=("from above", lambda s: abs(s["orbit"][1]) > 1.5 and s["settled"]))
    window.key("Escape", until=("the take", lambda s: s["compare"] == "single"))

    # cameras: menus, uses, the list
    window.stage("capture")
    press(window, "cam0", 3, ("its menu", lambda s: s["menu_camera"] == "cam0" and "camera list" in s["widgets"]))
    window.click("camera list", until=("the list", lambda s: s["dialog"] == "cameras"))
    window.click("dialog hold out cam1", 0.2)
    window.click("dialog use cam0")
    window.click("dialog save", until=("staleness", lambda s: s["dialog"] == "" and s["stages"]["train"][0] != "done"))
    assert capture().cameras == ("cam1", "cam2", "cam3", "cam4", "cam5")
    assert capture().held_out == ("cam1", "cam4")
    window.chord("z", until=("the results", lambda s: s["stages"]["train"][0] == "done"))
    assert capture() == uses
    press(window, "cam2", 1, ("one camera", lambda s: s["alone"] == "cam2" and s["settled"] and len(s["places"]) == 1))
    window.key("Escape", until=("all cameras", lambda s: s["alone"] == "" and len(s["places"]) == 6))
    menu = ("its menu", lambda s: s["menu_camera"] == "cam2" and "camera held out" in s["widgets"])
    state = press(window, "cam2", 3, menu)
    assert "camera training" not in state["widgets"]
    window.click("camera held out")
    window.wait_for("stale results", lambda s: s["menu_camera"] == "" and s["stages"]["train"][0] != "done")
    assert capture().held_out == ("cam2", "cam4")
    window.stage("calibrate")
    front = window.wait_for("frustums", lambda s: s["settled"] and len(s["places"]) > 2)["places"]
    nearest = list(front)[-1]
    press(window, nearest, 3, ("its menu", lambda s: s["menu_camera"] == nearest and "camera errors" in s["widgets"]))
    window.click("camera errors", until=("the report", lambda s: "report" in s["mode"] and s["settled"]))
    window.chord("c")
    window.saw("the table on the clipboard", lambda s: "Copied the table" in s["notice"])
    window.click("cameras", until=("the cameras", lambda s: "cameras" in s["mode"] and s["settled"]))
    press(window, nearest, 1, ("Review", lambda s: s["stage"] == "review" and s["camera"] == nearest and s["settled"]))

    # points marked by hand
    window.stage("calibrate")
    window.click("points by hand", until=("the view", lambda s: s["mode"] == ["points by hand"] and s["settled"]))
    file = take_copy / "points.yaml"
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
    assert window.close() == 0
