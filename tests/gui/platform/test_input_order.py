"""What falls on one draw of the window is lost: where draws are asked for between events."""

from __future__ import annotations

import ctypes
from contextlib import nullcontext

import pytest

from gui.platform import input_order
from gui.platform.input_order import LAG, PLAIN, Input, InputOrder, Order
from gui.platform.presses import SETTLED

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
    assert InputOrder(1).pointer is None, "nobody tells where it is"


class Keys:
    """An order with keys of its own.

    Attributes:
        order: it.
    """

    def __init__(self) -> None:
        order = self.order = InputOrder(None)
        self._arrived: list[Input] = []
        self._passed: list[Input] = []
        order._display, order._x = True, None
        order._read = lambda: iter([self._arrived.pop(0) for _ in range(len(self._arrived))])  # type: ignore[method-assign]
        order._send = lambda one: self._passed.append(one) if one else None  # type: ignore[func-returns-value,method-assign]

    def poll(self, hold: bool, *events: Input, release: bool = False) -> list[Input]:
        """What is passed on."""
        self._arrived.extend(events)
        self._passed.clear()
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(input_order, "errors_ignored", lambda *_: nullcontext())
            self.order.poll(hold, release)
        return list(self._passed)


def test_while_keys_are_kept_those_of_before_can_be_released() -> None:
    poll = Keys().poll
    up, b_up = Input("key up", A.code), Input("key up", B.code)
    assert poll(False, A) == [A]
    assert poll(True, B, b_up, up, ENTER, release=True) == [up]
    assert poll(True, release=True) == []
    assert poll(False) == [B, b_up, ENTER], "in their order"
    assert poll(False, A) == [A]
    assert poll(True, up) == [], "only if asked for"


def test_presses_and_repeats_of_keys_are_told_when_they_are_passed_on() -> None:
    keys = Keys()
    told: list[int] = []
    keys.order.pressed = told.append
    keys.poll(True, B, B)
    assert not told
    keys.poll(False)
    keys.poll(False, B, Input("key up", B.code), A)
    assert told == [B.code, B.code, B.code, A.code]


def test_a_key_that_is_held_while_a_dialog_opens_types_nothing_into_it() -> None:
    poll = Keys().poll
    up = Input("key up", A.code)
    assert poll(False, A) == [A]
    assert poll(True, A, A) == []
    assert poll(False, A, B) == [B], "still held"
    assert poll(False, up, A) == [up, A]
    assert poll(False, A) == [A], "held in the field, it repeats"


def test_it_comes_to_rest_once_when_all_keys_are_up_and_reported() -> None:
    keys = Keys()
    up = Input("key up", A.code)

    def rests_after(*events: Input, ticks: int = SETTLED) -> bool:
        keys.poll(False, *events)
        for _ in range(ticks - 1):
            keys.poll(False)
        return keys.order.came_to_rest()

    assert not rests_after(), "nothing was pressed"
    assert not rests_after(A), "still held"
    assert rests_after(up)
    assert not rests_after(), "once"
    assert not rests_after(A, up, ticks=2), "the toolkit may not have reported it yet"
    assert rests_after()
