"""What falls on one draw of the window is lost: where draws are asked for between events."""

from __future__ import annotations

import ctypes

import pytest

from gui.platform.input_order import LAG, PLAIN, Input, InputOrder, Order

PRESS, RELEASE, MOVE = Input("press", 1), Input("release", 1), Input("move")
A, B = Input("key", 38, typed=True), Input("key", 56, typed=True)
ENTER, ENTER_UP = Input("key", 36), Input("key up", 36)


def words(order: Order, *events: Input) -> str:
    """A letter per event, and "." per draw."""
    letters = {"press": "P", "release": "R", "move": "m", "key": "k", "key up": "u"}
    return "".join("." if one is None else letters[one.kind] for one in order.ordered(events))


def test_a_press_and_its_release_are_drawn_apart() -> None:
    assert words(Order(), PRESS, RELEASE) == "P.R"
    order = Order()
    assert words(order, PRESS) == "P"
    order.tick()
    assert words(order, RELEASE) == ".R", "read in two parts, they may still fall on one draw"
    order = Order()
    words(order, PRESS)
    for _ in range(LAG):
        order.tick()
    assert words(order, RELEASE) == "R", "it has been drawn long since"


def test_a_move_ends_a_press_for_the_toolkit_too() -> None:
    assert words(Order(), MOVE, MOVE, MOVE, PRESS, MOVE, MOVE, RELEASE) == "mP.mR"


def test_clicks_in_a_row_stay_clicks() -> None:
    assert words(Order(), PRESS, RELEASE, PRESS, RELEASE) == "P.R.P.R"


def test_keys_after_a_click_come_when_it_has_been_handled() -> None:
    assert words(Order(), PRESS, RELEASE, A, B) == "P.R..kk"


def test_typing_costs_no_draws_but_keys_that_edit_are_seen_in_order() -> None:
    assert words(Order(), A, B, A, B) == "kkkk"
    assert words(Order(), A, ENTER, ENTER_UP, B) == "k.k.uk"
    assert words(Order(), A, PRESS) == "k.P", "what is typed belongs to the field that had the focus"


def test_the_wheel_is_passed_on_as_it_comes() -> None:
    down, up = Input("press", 4), Input("release", 4)
    assert words(Order(), down, up, down, up) == "PRPR"


def test_it_can_be_turned_off(monkeypatch: pytest.MonkeyPatch) -> None:
    def load(_name: str) -> None:
        raise RuntimeError("X is used")

    monkeypatch.setattr(ctypes, "CDLL", load)
    monkeypatch.setattr("ctypes.util.find_library", lambda _name: "libX11.so.6")
    monkeypatch.setenv("DISPLAY", ":1")
    with pytest.raises(RuntimeError, match="X is used"):
        InputOrder(1)
    monkeypatch.setenv(PLAIN, "1")
    assert not InputOrder(1).active
