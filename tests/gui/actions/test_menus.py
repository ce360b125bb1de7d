"""Items of the menus are gray while they are not possible."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from gui.actions.menus import MENUS, MenuStates
from tests.support.waiting import wait_until

KEYS = [key for _, entries in MENUS for key, _ in entries if key]


class Bar:
    """What is told to the toolkit."""

    def __init__(self) -> None:
        self.told: list[tuple[int, bool]] = []

    def set_enabled(self, number: int, on: bool) -> None:
        self.told.append((number, on))


def test_only_changes_are_passed_on() -> None:
    reasons = {"undo": "nothing to undo"}
    states, bar = MenuStates(lambda key: reasons.get(key, "")), Bar()
    undo = KEYS.index("undo") + 1
    assert not states.update(None)
    assert states.update(bar)  # type: ignore[arg-type]
    assert bar.told == [(undo, False)], "items are possible at first"
    reasons.clear()
    assert states.update(bar)  # type: ignore[arg-type]
    assert bar.told == [(undo, False), (undo, True)]
    assert not states.update(bar)  # type: ignore[arg-type]


def test_what_is_not_possible_is_gray_in_the_window(
    open_window: Callable[..., Any], stream_folder: Path, artifacts: Path
) -> None:
    """The menu Edit of a stream: Undo, Redo and Trim are gray; a mark makes Undo possible."""
    window = open_window(str(stream_folder))
    window.wait_for("the stream", lambda s: s["frames"] == 12 and not s["opening"])
    left, top = window.point("stages", 0.0, 0.0)

    def brightest(row: int, name: str) -> int:
        """Of the text of an item of the open menu Edit."""
        pixels = np.asarray(Image.open(window.screenshot(artifacts / name)).convert("L"))
        y = top + 12 + round(24.3 * row)
        return int(pixels[y : y + 14, left + 50 : left + 90].max())

    window.press(left + 61, top - 12)
    wait_until("a gray item", lambda: 60 < brightest(0, "menu_gray.png") < 170)
    window.press(left + 61, top - 12)
    window.drawn()
    window.key("m")
    window.wait_for("a line with the keyboard", lambda s: s["dialog"] == "mark" and s["typing"])
    window.key("Return")
    window.wait_for("the mark", lambda s: s["marks"] == {"0": ""} and s["dialog"] == "")
    window.press(left + 61, top - 12)
    wait_until("a possible item", lambda: brightest(0, "menu_undo.png") > 200)
    assert brightest(1, "menu_undo.png") < 170, "there is nothing to redo"
    assert window.close() == 0
