from pathlib import Path

from tests.support.waiting import HandClock
from v3studio.gui.models.notices import SHOWN_SECONDS, Notices


def test_failures_stay_until_they_are_dismissed(clock: HandClock) -> None:
    notices = Notices(clock)
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
