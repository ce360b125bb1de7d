"""Close requests and presses of Escape, which the toolkit does not tell apart."""

from __future__ import annotations

import pytest

from gui.platform import closing
from gui.platform.closing import RELEASE, TICKS, WAIT, CloseRequests


class Keyboard:
    """A clock and an Escape key, moved by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.down = 100.0, False
        monkeypatch.setattr(closing.time, "monotonic", lambda: self.now)
        self.requests = CloseRequests(lambda: self.down)

    def closes(self, seconds: float = 2 * WAIT, ticks: int = 2 * TICKS) -> bool:
        """Whether the window closes within that time."""
        found = False
        for _ in range(ticks):
            self.now += seconds / ticks
            found |= self.requests.due()
        return found


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Keyboard:
    return Keyboard(monkeypatch)


def test_a_single_request_closes_the_window_once(keyboard: Keyboard) -> None:
    keyboard.requests.asked()
    assert not keyboard.closes(WAIT / 2)
    assert keyboard.closes()
    assert not keyboard.closes()


def test_the_menu_needs_no_waiting(keyboard: Keyboard) -> None:
    keyboard.requests.ask()
    assert keyboard.requests.due()


def test_press_and_release_are_no_request(keyboard: Keyboard) -> None:
    keyboard.requests.asked()
    keyboard.requests.asked()
    assert not keyboard.closes()
    keyboard.requests.asked()
    keyboard.requests.escape()  # the toolkit has told of the key
    assert not keyboard.closes()
    keyboard.requests.asked()
    assert keyboard.closes()


def test_an_escape_that_is_held_is_none(keyboard: Keyboard) -> None:
    """While text is edited, the toolkit tells of neither press nor release."""
    keyboard.down = True
    keyboard.requests.asked()
    assert not keyboard.closes(10 * WAIT)
    keyboard.down = False
    keyboard.requests.asked()
    assert not keyboard.closes()
    keyboard.requests.asked()
    assert keyboard.closes()


def test_a_release_that_is_seen_late_is_none(keyboard: Keyboard) -> None:
    """On a slow machine, when the press was given up already."""
    keyboard.down = True
    keyboard.requests.asked()
    keyboard.down = False
    assert not keyboard.closes()
    keyboard.requests.asked()
    assert not keyboard.closes()
    keyboard.requests.asked()
    assert keyboard.closes()


def test_without_a_release_later_requests_are_real(keyboard: Keyboard) -> None:
    keyboard.down = True
    keyboard.requests.asked()
    keyboard.down = False
    assert not keyboard.closes()
    keyboard.now += RELEASE
    keyboard.requests.asked()
    assert keyboard.closes()


def test_a_few_looks_at_the_keyboard_come_before(keyboard: Keyboard) -> None:
    keyboard.requests.asked()
    keyboard.now += 10 * WAIT  # a slow frame, in which the release waits
    assert not keyboard.requests.due()
    keyboard.requests.asked()
    assert not keyboard.closes()
