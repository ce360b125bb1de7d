"""Which menu is open is known from clicks and moves alone."""

from __future__ import annotations

import pytest

from gui.actions import menus
from gui.actions.menus import MENUS
from gui.platform.menu_bar import _TITLE_ENDS, MenuBar
from gui.widgets.picture import text_room

EM = 16


def bar() -> MenuBar:
    found = MenuBar(EM, menus.boxes(EM))
    found.height = 24
    return found


FILE, VIEW = (20, 12), (104, 12)


def test_titles_end_where_they_are_drawn() -> None:
    """The toolkit's layout: a margin, then the titles with equal gaps, half of which belongs to either title."""
    gap, end = 1.04, 0.75 - 1.04 / 2
    assert len(_TITLE_ENDS) == len(MENUS)
    for (title, _), measured in zip(MENUS, _TITLE_ENDS, strict=True):
        end += gap + text_room(title, 1.0)
        assert measured == pytest.approx(end, abs=0.2), title
    assert text_room("Publish", 1.0) > text_room("Share", 1.0) + 0.2, "another name would be noticed"


def test_a_click_opens_and_closes() -> None:
    menu = bar()
    assert menu.press(*FILE)
    assert menu.opened
    assert menu.press(*FILE)
    assert not menu.opened


def test_a_click_on_the_next_title_does_not_close_what_the_pointer_has_opened() -> None:
    menu = bar()
    menu.press(*FILE)
    menu.move(*VIEW)
    assert not menu.press(*VIEW)
    assert menu.opened
    assert menu.press(*VIEW), "a second click closes it"
    assert not menu.opened


def test_a_click_on_no_item_leaves_the_menu_open() -> None:
    """The menu Help: places that are surely inside, and surely outside."""
    menu = bar()
    menu.press(300, 12)
    for place in ((400, 82), (286, 100), (513, 40), (400, 156)):
        assert menu.press(*place)
        assert menu.opened, place
    menu.closed()
    assert not menu.opened, "an item was chosen"
    for place in ((278, 60), (900, 60), (400, 400)):
        menu.press(300, 12)
        assert menu.press(*place)
        assert not menu.opened, place


def test_a_click_elsewhere_closes() -> None:
    for place in ((300, 300), bar().empty, (300, 40)):
        menu = bar()
        menu.press(*FILE)
        assert menu.press(*place)
        assert not menu.opened, place
    menu = bar()
    assert menu.press(*menu.empty)
    assert not menu.opened


def test_moving_over_the_bar_opens_nothing() -> None:
    menu = bar()
    menu.move(*VIEW)
    assert not menu.opened
