"""Notices go by themselves."""

from __future__ import annotations

from gui.presenters.notices import SHOWN_SECONDS, Notices


def test_a_notice_is_shown_for_a_while() -> None:
    now = [0.0]
    notices = Notices(lambda: now[0])
    assert notices.text == ""
    notices.tell("Written:\nwalk.mp4")
    assert (notices.text, notices.bad) == ("Written: walk.mp4", False)
    now[0] = SHOWN_SECONDS - 1
    notices.tell("no such folder", bad=True)
    now[0] = SHOWN_SECONDS + 5
    assert notices.bad, "the newer one counts from its own time"
    now[0] = 2 * SHOWN_SECONDS
    assert (notices.text, notices.bad) == ("", False)
    notices.tell("a")
    notices.clear()
    assert notices.text == ""
