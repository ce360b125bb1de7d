"""What is pasted on the start page, and the menu while it is shown."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gui.actions.start import StartActions, path_in
from gui.models.loop import Signal
from gui.models.notices import Notices


class Window:
    """What the actions use of the main window; keeps what was opened."""

    def __init__(self) -> None:
        self.notices = Notices()
        self.workspace = SimpleNamespace(opening="")
        self.opened: list[str] = []
        self.player = SimpleNamespace(opened=None, transport=SimpleNamespace(pause=lambda: None))
        self.start = SimpleNamespace(shown=True)
        self.layout = SimpleNamespace(set_start=lambda on: setattr(self.start, "shown", on))
        self.changed = lambda: None

    def open(self, place: str) -> None:
        """Note it."""
        self.opened.append(place)


@pytest.fixture
def window() -> Window:
    return Window()


def actions_of(window: Any, footage: list[str]) -> StartActions:
    queue, clipboard = SimpleNamespace(changed=Signal()), SimpleNamespace()
    new_take: Any = lambda new: footage.append(new.footage)  # noqa: E731
    return StartActions(window, queue, clipboard, {}, new_take)  # type: ignore[arg-type]


@pytest.mark.parametrize("quote", ["{}", "'{}'", "{}\n"])
@pytest.mark.parametrize("host", ["", "localhost"])
def test_a_copied_file_address_is_a_path(tmp_path: Path, window: Window, quote: str, host: str) -> None:
    folder = tmp_path / "Läufer 100% #2"
    folder.mkdir()
    address = folder.as_uri().replace("file://", f"file://{host}")
    assert "%20" in address
    footage: list[str] = []
    actions_of(window, footage).pasted(quote.format(address))
    assert footage == [str(folder)]
    assert path_in("/takes/100%25") == "/takes/100%25", "a path is taken as it is"
    assert path_in("https://example.org/a%20b") == "https://example.org/a%20b"


def test_the_folder_of_an_unknown_user_is_told(window: Window) -> None:
    actions_of(window, []).pasted("~no-such-user-anywhere/takes")
    assert window.opened == []
    assert window.notices.card.bad
    assert "no such user" in window.notices.text
