"""Hints, lists and tooltips: none covers what it is about, and none gets in the way of another."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tests.support.waiting import wait_until


def test_hints_cover_no_button(open_window: Callable[..., Any], stream_folder: Path, artifacts: Path) -> None:
    window = open_window(str(stream_folder))
    window.wait_for("the stream", lambda s: s["shown"] is not None)
    names = ("truth", "wipe", "difference", "edit", "play", "speed", "reset view", "all")
    for name, words in (("wipe", "Wipe against"), ("reset view", "Reset the view"), ("all", "Run all")):
        window.xdotool("mousemove", *window.point(name))
        state = window.wait_for(
            f"a hint of {name}", lambda s, words=words: words in s["hint"] and s["widgets"].get("hint", [0])[0]
        )
        window.drawn()
        window.screenshot(artifacts / f"hint_{name.replace(' ', '_')}.png")
        state = window.states()[-1]
        left, top, width, height = state["widgets"]["hint"]
        for other in names:
            x, y, wide, high = state["widgets"][other]
            assert left + width <= x or x + wide <= left or top + height <= y or y + high <= top, (name, other)
        view = state["widgets"]["viewport"]
        over_view = top + height > view[1] and top < view[1] + view[3]
        assert over_view == (name == "all"), "the others have room in the menu bar or in their row"

    # none after a click until the pointer has left the button
    window.click("wipe")
    window.wait_for("that a stream has nothing to compare with", lambda s: s["message"])
    known = len(window.states())
    window.ticks(80)
    assert not any(state["hint"] for state in window.states()[known:])
    window.xdotool("mousemove", *window.point("viewport"))
    window.drawn()
    window.xdotool("mousemove", *window.point("wipe"))
    window.wait_for("the hint", lambda s: "Wipe against" in s["hint"])

    # none while a list is open, which it would close
    window.click("speed")
    known = len(window.states())
    window.ticks(80)
    window.xdotool("mousemove", *window.point("play"))
    window.ticks(80)
    assert not any(state["hint"] for state in window.states()[known:])
    seen = cv2.imread(str(window.screenshot(artifacts / "hint_list.png")))
    x, y = window.point("speed", 0.3, -0.5)
    left, top = window.point("timeline", 0.0, 0.0)
    assert (seen[y - 20 : y, x - 10 : x + 10] != seen[top + 1, left + 1]).any(), "the list is open above the button"
    window.press(*window.point("viewport", 0.9, 0.1))
    window.xdotool("mousemove", *window.point("play"))
    window.wait_for("the hint", lambda s: "Play" in s["hint"])

    # the list of commands is closed by a click beside it
    window.chord("k")
    window.wait_for("the list", lambda s: s["dialog"] == "commands" and s["typing"])
    window.click("dialog list", 0.5, 1.06)
    assert window.states()[-1]["dialog"] == "commands", "beside the list, but in the dialog"
    playing = window.states()[-1]["playing"]
    window.click("play")
    state = window.wait_for("no dialog", lambda s: not s["dialog"])
    assert state["playing"] == playing, "the click is for the dialog only"
    assert window.close() == 0


def test_a_tooltip_has_the_size_of_its_text(
    open_window: Callable[..., Any], finished_project: Path, tmp_path: Path, artifacts: Path
) -> None:
    window = open_window(str(shutil.copytree(finished_project / "take", tmp_path / "take")))
    window.wait_for("the take", lambda s: s["shown"] is not None and s["settled"])
    window.stage("capture")
    window.click("settings filter")
    window.enter_text("settings filter", "mask")
    settings = ["setting capture.mask_shadows", "setting capture.mask_components", "setting capture.masks"]
    window.wait_for("the settings", lambda s: settings[0] in s["widgets"])
    places = [window.point(name) for name in settings]

    def seen() -> np.ndarray:
        whole = cv2.imread(str(window.screenshot(artifacts / "tooltip.png")))
        return np.asarray(whole[places[0][1] - 120 : places[0][1] + 250, places[0][0] - 60 : places[0][0] + 700])

    wanted = []
    for place in places:
        window.xdotool("mousemove", *place)
        for _ in range(4):
            window.send("key", "Shift_L")  # draws the window again
            window.ticks(60)
        wanted.append(seen())
    assert not np.array_equal(wanted[0], wanted[1]), "each has a text of its own"
    for place, expected in zip(places, wanted, strict=True):
        window.xdotool("mousemove", *place)
        wait_until("the whole tooltip", lambda expected=expected: np.array_equal(seen(), expected), 60)
    assert window.close() == 0
