"""The buttons of a notice: a page that was written can be opened in the browser."""

from __future__ import annotations

from pathlib import Path

from gui.models.notices import Notices
from gui.platform.desktop import PageOpener
from gui.widgets.notice_bar import NoticeActions, NoticeBar


class Pages(PageOpener):
    """Fails, after a while."""

    def __init__(self) -> None:
        self.opened: list[Path] = []
        self.told = ""

    def open(self, page: Path) -> str:
        self.opened.append(page)
        return ""

    def failure(self) -> str:
        told, self.told = self.told, ""
        return told


def test_pages_can_be_opened_and_failure_is_told() -> None:
    notices, pages = Notices(lambda: 0.0), Pages()
    bar = NoticeBar(notices, 16.0, NoticeActions(int, int, int, pages), lambda: None)
    notices.tell("Shared: /shares/walk", path=Path("/shares/walk"))
    assert bar.update(800.0, hidden=False)
    assert list(bar.buttons) == ["open_folder", "copy", "dismiss"], "a folder needs a web server"
    page = Path("/shares/walk.html")
    notices.tell(f"Shared: {page}", path=page)
    assert bar.update(800.0, hidden=False)
    assert list(bar.buttons) == ["open_page", "open_folder", "copy", "dismiss"]
    bar._open(page)
    assert pages.opened == [page]
    assert not bar.update(800.0, hidden=False)
    pages.told = "no browser"
    assert bar.update(800.0, hidden=False)
    assert notices.card is not None
    assert (notices.card.text, notices.card.bad) == ("no browser", True)
