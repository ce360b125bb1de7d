"""The buttons above the view."""

from __future__ import annotations

from itertools import pairwise

import pytest
from open3d.visualization import gui

from gui.pages.review.tools import EDIT_CHOICES
from gui.widgets.flow import Flow
from gui.widgets.hints import Hints
from gui.widgets.modes import ModesPanel


def test_a_pressed_button_is_marked_under_the_pointer() -> None:
    sets = {"review": (("wipe", "Wipe", ""), ("difference", "Difference", ""))}
    panel = ModesPanel(sets, 16.0, lambda _stage, _key: None, Hints(True, 16.0))
    for number, button in enumerate(panel.buttons.values()):
        button.frame = gui.Rect(300 + 100 * number, 28, 90, 24)
    bar = panel._bars["review"].widget
    panel.update("review", {"wipe"}, (), (420, 40))
    assert not bar.visible, "that one is not pressed, and gray as all are under the pointer"
    panel.update("review", {"wipe"}, (), (320, 40))
    assert bar.visible
    assert (bar.frame.x, bar.frame.width, bar.frame.y + bar.frame.height) == (300, 90, 52)
    assert 2 <= bar.frame.height <= 5
    panel.update("review", set(), (), (320, 40))
    assert not bar.visible


def test_as_many_words_as_fit_into_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    panel = ModesPanel({"edit": EDIT_CHOICES}, 16.0, lambda _stage, _key: None, Hints(True, 16.0))
    keys = [key for _, key in panel.buttons]

    def wide() -> float:
        # as measured in the window: 8 pixels a letter, 18 an icon, 12 around them
        texts = [button.text for button in panel.buttons.values()]
        letters = sum(8 * len(text) if text.isascii() else 18 + 8 * len(text[1:]) for text in texts)
        return letters + 12 * len(texts) + panel.rows["edit"].spacing * (4 * len(texts) + 8 * 6)

    def height(row: Flow, width: float, _context: object) -> float:
        return 24.0 if wide() <= width else 52.0

    def words(width: float) -> list[str]:
        panel.place("edit", 0, 0, width, None)
        assert wide() <= width
        return [key for key in keys if len(panel.buttons["edit", key].text) > 1]

    monkeypatch.setattr(Flow, "height", height)
    monkeypatch.setattr(Flow, "place", lambda *of: None)
    assert words(2500) == keys
    assert not panel.buttons["edit", "crop"].text.isascii(), "icon and words"
    found = [words(width) for width in (2500, 1500, 1350, 1200, 1100, 1000, 900, 780, 630)]
    assert all(set(fewer) <= set(more) for more, fewer in pairwise(found)), "what has words keeps them with more room"
    assert {"floaters", "numbers", "removed"} <= set(found[4]) < set(keys)
    assert found[-1] == ["done"]
    assert panel.rows["edit"].spacing < 1
    assert words(1500) == keys
    assert panel.buttons["edit", "crop"].text == "Crop", "all words, without icons"
    assert panel.rows["edit"].spacing == 1
