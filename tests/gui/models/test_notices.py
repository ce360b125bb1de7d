"""Notices: passing ones go by themselves, failures stay until they are dismissed."""

from pathlib import Path

import pytest

from gui.models.notices import SHOWN_SECONDS, Notices
from tests.support.waiting import HandClock


@pytest.fixture
def notices(clock: HandClock) -> Notices:
    return Notices(clock)


def test_failures_stay_until_they_are_dismissed(notices: Notices, clock: HandClock) -> None:
    notices.show("no such folder", bad=True)
    notices.show("the disk is full", bad=True)
    clock.time = 1e6
    assert (notices.card.text, notices.more, notices.card.bad) == ("the disk is full", 1, True)
    notices.show("Written: a.ply", path=Path("a.ply"))
    assert (notices.card.text, notices.more, notices.card.bad) == ("Written: a.ply", 2, False)
    clock.time += SHOWN_SECONDS + 1
    assert (notices.card.text, notices.more) == ("the disk is full", 1)
    assert notices.dismiss()
    assert notices.text == "no such folder"
    assert notices.dismiss()
    assert (notices.text, notices.more, notices.dismiss()) == ("", 0, False)
