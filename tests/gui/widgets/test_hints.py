"""Hints: when they come, and where they lie."""

from collections.abc import Sequence

import pytest
from open3d.visualization import gui

from gui.widgets.hints import DELAY, Hints
from tests.support.waiting import HandClock

EM = 16.0


def button(x: int, y: int, width: int = 80, height: int = 24) -> gui.Button:
    made = gui.Button("x")
    made.frame = gui.Rect(x, y, width, height)
    return made


def row_of(hints: Hints, frame: tuple[int, int, int, int], buttons: Sequence[gui.Widget], text: str) -> gui.Widget:
    row = gui.Widget()
    row.frame = gui.Rect(*frame)
    for one in buttons:
        hints.give(one, text, row)
    return row


@pytest.fixture
def hints(clock: HandClock) -> Hints:
    return Hints(True, EM, clock)


def rest(hints: Hints, clock: HandClock, at: tuple[int, int], hidden: bool = False) -> str:
    """The hint after the pointer has rested at a position."""
    hints.update(at, hidden)
    clock.time += 2 * DELAY
    hints.update(at, hidden)
    return hints.text


def test_none_after_a_click_until_the_pointer_has_left(hints: Hints, clock: HandClock) -> None:
    row = row_of(hints, (300, 28, 700, 24), [button(300, 28), button(400, 28)], "what it does")
    assert rest(hints, clock, (310, 40)) == "what it does"
    hints.press(310, 40, [])
    assert rest(hints, clock, (310, 40), hidden=True) == ""
    assert rest(hints, clock, (312, 40)) == "", "the button is released, and the pointer still on it"
    assert rest(hints, clock, (410, 40)) == "what it does", "another button"
    assert rest(hints, clock, (310, 40)) == "what it does", "it came back"
    row.visible = False
    assert rest(hints, clock, (310, 40)) == ""


def test_a_list_is_open_from_the_click_on_it_to_the_next_click(hints: Hints) -> None:
    lists = [button(300, 700), button(400, 700)]
    hints.press(310, 710, lists)
    assert hints.listing
    hints.press(350, 600, lists)
    assert not hints.listing, "one of its items was chosen"
    hints.press(410, 710, lists)
    hints.press(410, 710, lists)
    assert not hints.listing, "the second click on it closes it"
    lists[0].visible = False
    hints.press(310, 710, lists)
    assert not hints.listing
