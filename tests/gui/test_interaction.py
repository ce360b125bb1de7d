"""Mouse and keys faster than the window is drawn: nothing is lost, and nothing acts on what it was not meant for."""

from pathlib import Path

import numpy as np
import pytest

from tests.gui.conftest import CLICK, RunningWindow
from tests.support.waiting import wait_until
from v3studio.gui.drawing.palette import PANEL
from v3studio.pipelines.takes.authored.marks import read_marks

CORNER = (slice(0, 60), slice(0, 150))
"""The part of a widget that an open menu covers."""


class Menus:
    """The menus of the window, as they cover what is below them."""

    def __init__(self, window: RunningWindow) -> None:
        window.drawn()
        self._window, self._closed = window, {name: window.pixels(name)[CORNER] for name in ("stages", "viewport")}

    def covers(self, name: str) -> bool:
        """Whether a menu covers the upper left corner of a widget."""
        return bool((self._window.pixels(name)[CORNER] != self._closed[name]).any(axis=2).mean() > 0.5)

    def press(self, name: str, *more: object) -> None:
        """Press and release on a title or an item at once."""
        self._window.xdotool("mousemove", *self._window.menu_place(name), *(more or CLICK))

    def open_file(self) -> None:
        self.press("File")
        wait_until("the menu File", lambda: self.covers("stages"))


@pytest.fixture
def menus(window: RunningWindow) -> Menus:
    return Menus(window)


@pytest.mark.parametrize("name", ["wipe", "difference"])
def test_a_button_that_is_pressed_and_released_at_once_acts(window: RunningWindow, name: str) -> None:
    window.xdotool("mousemove", *window.point(name), *CLICK)
    window.wait_for(name, lambda s: s["compare"] == name)


def test_text_is_typed_into_the_dialog_that_the_click_before_it_opens(window: RunningWindow, menus: Menus) -> None:
    compared = window.states()[-1]["compare"]
    menus.press("File")
    window.drawn()
    menus.press("new", *CLICK, "type", "--delay", "1", "typed at once")
    state = window.wait_for("what was typed", lambda s: s["texts"].get("dialog footage") == "typed at once")
    assert (state["dialog"], state["compare"]) == ("new take", compared), "no letter was a shortcut"
    window.click("dialog close")
    wait_until("no shade", lambda: not menus.covers("stages"))


def test_one_click_goes_from_one_open_menu_to_another(window: RunningWindow, menus: Menus) -> None:
    menus.open_file()
    menus.press("Help")
    wait_until("the menu Help", lambda: menus.covers("viewport") and not menus.covers("stages"))
    menus.press("shortcuts")
    window.wait_for("the shortcuts", lambda s: s["dialog"] == "message")


def test_escape_closes_a_menu_and_chooses_nothing(window: RunningWindow, menus: Menus) -> None:
    menus.open_file()
    menus.press("new", "key", "Escape", *CLICK)  # the pointer is on an item; a click there is for what is below
    window.wait_for("the stage below the menu", lambda s: s["stage"] == "capture" and not s["dialog"])


def test_escape_that_is_released_while_a_mouse_button_is_down_closes_no_window(window: RunningWindow) -> None:
    window.send("keydown", "Escape")
    window.send("mousemove", *window.point("reset view"), "mousedown", 1)
    window.send("keyup", "Escape")  # the toolkit reports nothing of it
    window.ticks(80)
    window.send("mouseup", 1)
    window.stage("review")


def test_the_large_log_covers_a_view_that_a_click_has_brought_to_the_front(window: RunningWindow) -> None:
    window.key("j")
    window.click("log", 0.3, 0.8)
    window.key("j")
    window.click("viewport")
    window.key("j")
    window.drawn()
    pixels = window.pixels("log")
    assert np.median(np.abs(pixels.astype(int) - PANEL).max(2)) == 0, "nearly all of it has the color of panels"
    window.key("j")


def test_a_note_is_typed_right_after_the_key_that_opens_its_dialog(window: RunningWindow, take: Path) -> None:
    window.xdotool("mousemove", *window.point("viewport"), "key", "m", "type", "--delay", "15", "typed right after")
    window.wait_for("the note", lambda s: s["texts"].get("dialog line") == "typed right after")
    window.key("Return")
    window.wait_for("the mark", lambda s: list(s["marks"].values()) == ["typed right after"] and not s["dialog"])
    (mark,) = read_marks(take / "marks.json").values()
    assert mark.view is not None
    window.chord("z", until=("no mark", lambda s: not s["marks"]))


def test_a_double_click_does_not_go_on_to_what_takes_the_place_of_a_button(window: RunningWindow) -> None:
    chosen = window.states()[-1]["what"]
    window.xdotool("mousemove", *window.point("edit"), *CLICK, *CLICK)
    window.wait_for("the edits", lambda s: "remove" in s["widgets"])
    window.ticks(60)
    assert "remove" in window.states()[-1]["widgets"]
    window.xdotool("mousemove", *window.point("done"), *CLICK, *CLICK)
    window.wait_for("the take", lambda s: "footage" in s["widgets"])
    window.ticks(60)
    assert window.states()[-1]["what"] == chosen, "Footage, which came to the place of Done, was not chosen"


def test_a_take_whose_folder_is_removed_is_no_bug(window: RunningWindow, take: Path) -> None:
    take.rename(take.with_name("moved"))
    gone = window.wait_for("a message", lambda s: "folder of this take is gone" in s["message"])
    assert gone["message"].startswith(f"{take}: ")
    for name in ("capture", "train", "bake"):
        window.choose("stages", name)
        state = window.wait_for(name, lambda s, name=name: s["stage"] == name and s["settled"])
        assert state["message"] == gone["message"]
        assert state["notice"] in ("", gone["notice"]), "nothing but the remark of an earlier test"
    window.click("all")
    window.ticks(30)
    assert not window.states()[-1]["busy"]
    assert window.states()[-1]["notice"] in ("", gone["notice"])
    take.with_name("moved").rename(take)
    window.wait_for("the take", lambda s: s["message"] == "" and s["stages"]["bake"][0] == "done")
