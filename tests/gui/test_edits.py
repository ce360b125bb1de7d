"""Edits in the real window: tools by mouse, numbers and undo by keyboard; then tie points marked by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipelines.takes.edits import read_edits
from studio.calibration import read_tie_points
from studio.edits import EditList
from tests.support.waiting import wait_until


def bright(window: Any, path: Path) -> int:
    """Number of bright pixels in the lower left of the view, where nobody stands."""
    rows, columns = window.inside("viewport")
    wide, high = columns.stop - columns.start, rows.stop - rows.start
    picture = np.asarray(Image.open(window.screenshot(path)).convert("L"))
    return int((picture[rows.stop - high // 2 : rows.stop, columns.start : columns.start + wide // 3] > 150).sum())


def wider(window: Any, path: Path, before: int) -> int:
    """How many more there are, once there are more."""
    wait_until("a larger circle", lambda: bright(window, path) > before)
    return bright(window, path) - before


def test_edits_and_tie_points(open_window: Callable, take_copy: Path, artifacts: Path) -> None:
    window = open_window(str(take_copy))
    window.wait_for("a take", lambda s: s["stages"]["review"][0] == "done" and s["shown"] is not None)
    window.key("Home")
    window.key("x")
    window.wait_for("the edits", lambda s: "look" in s["mode"] and "lasso" in s["widgets"] and s["settled"])
    window.click("lasso")
    window.wait_for("the lasso", lambda s: "lasso" in s["mode"])
    window.drag("viewport", (0.3, 0.3), (0.7, 0.4))  # a line: nothing is inside
    window.wait_for("no selection", lambda s: s["settled"] and s["selected"] == 0)
    window.click("brush")
    window.wait_for("the brush", lambda s: "brush" in s["mode"])
    tops = {window.states()[-1]["widgets"][name][1] for name in ("done", "brush", "remove here", "removed")}
    assert len(tops) == 1, "all buttons in one row"
    before = bright(window, artifacts / "edits_brush_away.png")
    window.send("mousemove", *window.point("viewport", 0.2, 0.7))
    small = wider(window, artifacts / "edits_brush_circle.png", before)
    window.key("plus")
    large = wider(window, artifacts / "edits_brush_large.png", before + small)
    assert large > 0, "a larger circle has more pixels"
    window.key("minus")
    window.drag("viewport", (0.45, 0.5), (0.55, 0.5))
    window.wait_for("a selection", lambda s: s["selected"] > 0)
    window.screenshot(artifacts / "edits_brush.png")
    window.click("remove here")
    window.wait_for("one group to bake", lambda s: "regions 1" in s["edits"] and s["stages"]["bake"][0] == "partial")
    (region,) = read_edits(take_copy / "edits.json").regions
    assert region.radius is not None
    assert region.frames == (0, 0)
    window.click("numbers")
    window.wait_for("typing", lambda s: s["dialog"] == "numbers" and s["typing"] and "dialog radius" in s["texts"])
    window.key("6")
    window.wait_for("a radius", lambda s: s["texts"]["dialog radius"] == "6")
    window.key("Return")
    window.wait_for("the view", lambda s: s["dialog"] == "")
    window.click("look")
    window.wait_for("no tool", lambda s: "look" in s["mode"])
    window.click("numbers")
    window.wait_for("kinds", lambda s: s["dialog"] == "edit kinds")
    window.click("dialog choice1")
    state = window.wait_for("typing", lambda s: s["dialog"] == "numbers" and s["typing"])
    assert state["widgets"]["dialog height"][2] >= 16 * 16, "16 em: three numbers can be read"
    window.enter_text("dialog height", "0.1")
    window.key("Return")
    window.wait_for("a ground", lambda s: s["dialog"] == "" and "ground" in s["edits"])
    window.chord("z")
    window.chord("z")
    window.wait_for("no edits", lambda s: s["edits"] == {} and s["stages"]["bake"][0] == "done")
    assert read_edits(take_copy / "edits.json") == EditList()
    window.click("detail")
    window.wait_for("the tool", lambda s: "detail" in s["mode"] and s["settled"])
    window.drag("viewport", (0.5, 0.5), (0.5, 0.5))
    window.wait_for("training to do again", lambda s: "details 1" in s["edits"] and s["stages"]["train"][0] != "done")
    window.wait_for("a picture of it", lambda s: s["settled"])
    window.screenshot(artifacts / "edits_detail.png")
    window.click("numbers")
    window.wait_for("typing", lambda s: s["dialog"] == "numbers" and s["typing"])
    window.key("1")
    window.wait_for("a radius", lambda s: s["texts"]["dialog radius"] == "1")
    window.key("Return")
    window.wait_for("the radius", lambda s: s["dialog"] == "" and "radius 1," in s["edits"]["details 1"])
    window.chord("z")
    window.chord("z")
    window.wait_for("no detail", lambda s: s["edits"] == {} and s["stages"]["train"][0] == "done")
    window.key("Escape")
    window.wait_for("the take", lambda s: "decoded" in s["mode"])

    # points marked by hand
    window.stage("calibrate")
    window.click("points by hand")
    window.wait_for("the view", lambda s: s["mode"] == ["points by hand"] and s["settled"])
    file = take_copy / "points.yaml"
    window.click("viewport", 0.6, 0.5)
    wait_until("a point in the file", file.is_file)
    (point,) = read_tie_points(file)
    assert len(point.pixels) == 1
    pictures = window.states()[-1]["pictures"]
    window.key("c")
    window.wait_for("the next camera", lambda s: s["pictures"] > pictures and s["settled"])
    window.click("viewport", 0.6, 0.55)
    wait_until("two marks in the file", lambda: len(read_tie_points(file)[0].pixels) == 2)
    window.key("e")
    window.wait_for("the dialog", lambda s: s["dialog"] == "point" and s["typing"])
    window.retype("dialog line", "corner; 0 0 1")
    window.key("Return")
    window.wait_for("no dialog", lambda s: not s["dialog"])
    window.screenshot(artifacts / "points_by_hand.png")
    assert read_tie_points(file)[0].name == "corner"
    assert read_tie_points(file)[0].world == (0, 0, 1)
    assert window.close() == 0
