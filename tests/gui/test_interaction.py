"""Mouse and keys faster than the window is drawn: nothing is lost, and nothing acts on what it was not meant for."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.gui.conftest import CLICK, RunningWindow
from tests.support.waiting import wait_until
from v3studio.gui.drawing.palette import PANEL


def test_input_that_is_faster_than_the_window(open_window: Callable[..., RunningWindow], take_copy: Path) -> None:
    window = open_window(str(take_copy))
    state = window.wait_for("the take", lambda s: s["shown"] is not None and s["stages"]["review"][0] == "done")
    left, top = window.point("stages", 0.0, 0.0)
    titles = {"File": (left + 22, top - 12), "Help": (left + 306, top - 12)}

    # pressed and released at once
    for name in ("wipe", "difference"):
        window.xdotool("mousemove", *window.point(name), *CLICK)
        window.wait_for(name, lambda s, name=name: s["compare"] == name)

    # text right after the click that opens the dialog: File > New take
    corner = (slice(0, 60), slice(0, 150))
    window.drawn()
    before = window.pixels("stages")[corner]
    window.xdotool("mousemove", *titles["File"], *CLICK)
    window.drawn()
    window.xdotool("mousemove", left + 42, top + 21, *CLICK, "type", "--delay", "1", "typed at once")
    state = window.wait_for("what was typed", lambda s: s["texts"].get("dialog footage") == "typed at once")
    assert (state["dialog"], state["compare"]) == ("new take", "difference"), "no letter was a shortcut"
    window.click("dialog close")
    wait_until("no shade", lambda: np.array_equal(window.pixels("stages")[corner], before))

    # one click goes from one open menu to another: Help > Shortcuts
    closed = {name: window.pixels(name) for name in ("stages", "viewport")}

    def covered(name: str) -> bool:
        """Whether a menu covers the upper left corner of a widget."""
        return bool((window.pixels(name)[corner] != closed[name][corner]).any(axis=2).mean() > 0.5)

    window.xdotool("mousemove", *titles["File"], *CLICK)
    wait_until("the menu File", lambda: covered("stages"))
    window.xdotool("mousemove", *titles["Help"], *CLICK)
    wait_until("the menu Help", lambda: covered("viewport") and not covered("stages"))
    window.xdotool("mousemove", left + 326, top + 21 + round(24.3 * 2 + 6.4), *CLICK)
    window.wait_for("the shortcuts", lambda s: s["dialog"] == "message")
    window.key("Escape", until=("no dialog", lambda s: not s["dialog"]))

    # Escape closes a menu and chooses nothing, though the pointer is on an item; a click there is for what is below
    window.xdotool("mousemove", *titles["File"], *CLICK)
    wait_until("the menu File", lambda: covered("stages"))
    window.xdotool("mousemove", left + 42, top + 21, "key", "Escape", *CLICK)
    window.wait_for("the stage below the menu", lambda s: s["stage"] == "capture" and not s["dialog"])

    # Escape that is released while a mouse button is down, of which the toolkit reports nothing, closes no window
    window.send("keydown", "Escape")
    window.send("mousemove", *window.point("reset view"), "mousedown", 1)
    window.send("keyup", "Escape")
    window.ticks(80)
    window.send("mouseup", 1)
    window.stage("review")
    wait_until("no menu", lambda: not covered("stages"))

    # the enlarged log covers the view, also when a click has brought the view to the front of all
    window.key("j")
    window.click("log", 0.3, 0.8)
    window.key("j")
    window.click("viewport")
    window.key("j")
    window.drawn()
    pixels = window.pixels("log")
    assert np.median(np.abs(pixels.astype(int) - PANEL).max(2)) == 0, "nearly all of it has the color of panels"
    window.key("j")

    # a note typed right after the key that opens its dialog
    window.xdotool("mousemove", *window.point("viewport"), "key", "m", "type", "--delay", "15", "typed right after")
    window.wait_for("the note", lambda s: s["texts"].get("dialog line") == "typed right after")
    window.key("Return")
    window.wait_for("the mark", lambda s: list(s["marks"].values()) == ["typed right after"] and not s["dialog"])

    # a double click on Edit does not go on to what takes its place
    window.xdotool("mousemove", *window.point("edit"), *CLICK, *CLICK)
    window.wait_for("the edits", lambda s: "remove" in s["widgets"])
    window.ticks(60)
    before = window.states()[-1]
    assert "remove" in before["widgets"]
    window.xdotool("mousemove", *window.point("done"), *CLICK, *CLICK)
    window.wait_for("the take", lambda s: "footage" in s["widgets"])
    window.ticks(60)
    assert window.states()[-1]["what"] == state["what"], "Footage, which came to the place of Done, was not chosen"

    # a take whose folder is removed is no bug, and nothing is said that holds no more
    take_copy.rename(take_copy.with_name("moved"))
    gone = window.wait_for("a message", lambda s: "folder of this take is gone" in s["message"])
    assert gone["message"].startswith(f"{take_copy}: ")
    for name in ("capture", "train", "bake"):
        window.click("stages", 0.3, (list(gone["stages"]).index(name) + 0.5) / len(gone["stages"]))
        state = window.wait_for(name, lambda s, name=name: s["stage"] == name and s["settled"])
        assert (state["message"], state["notice"]) == (gone["message"], "")
    window.click("all")
    window.ticks(30)
    assert (window.states()[-1]["notice"], window.states()[-1]["busy"]) == ("", False)
    take_copy.with_name("moved").rename(take_copy)
    window.wait_for("the take", lambda s: s["message"] == "" and s["stages"]["bake"][0] == "done")
    assert "Traceback" not in window.stderr.read_text()
    assert window.close() == 0, window.stderr.read_text()[-2000:]
