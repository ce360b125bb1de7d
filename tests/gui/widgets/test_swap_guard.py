"""A click is refused for a moment if buttons were exchanged under the pointer, and only then."""

from __future__ import annotations

from gui.widgets.swap_guard import WAIT, SwapGuard


def test_only_a_resting_pointer_and_only_for_a_moment() -> None:
    now, place = [10.0], [(100, 100)]
    guard = SwapGuard(lambda: place[0], 16, lambda: now[0])
    assert not guard.refuses()
    guard.swapped()
    assert guard.refuses()
    now[0] += 60
    assert guard.refuses(), "the change has not been drawn yet: nobody can have seen it"
    guard.drawn()
    now[0] += WAIT - 0.01
    guard.drawn()
    assert guard.refuses()
    place[0] = (140, 100)
    assert not guard.refuses(), "who moves to another button means it"
    place[0] = (103, 98)
    assert guard.refuses(), "a hand trembles"
    now[0] += 0.02
    assert not guard.refuses()


def test_where_the_pointer_is_not_known_nothing_is_refused() -> None:
    guard = SwapGuard(lambda: None, 16, lambda: 10.0)
    guard.swapped()
    assert not guard.refuses()
    guard.drawn()
    assert not guard.refuses()
