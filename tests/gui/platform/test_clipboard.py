"""The clipboard between two programs."""

import os
from collections.abc import Iterator

import pytest

from gui.platform.clipboard import Clipboard
from tests.support.waiting import wait_until


@pytest.fixture
def two(display: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Clipboard, Clipboard]]:
    monkeypatch.setenv("DISPLAY", display)
    found = Clipboard(), Clipboard()
    yield found
    for one in found:
        one.close()


def paste(asking: Clipboard, answering: Clipboard) -> str:
    texts: list[str] = []

    def came() -> bool:
        if answering is not asking:
            answering.poll()
        text = asking.poll()
        if text is not None:
            texts.append(text)
        return bool(texts)

    assert asking.ask()
    wait_until("the text", came)
    return texts[0]


def test_text_goes_from_one_program_to_the_other(two: tuple[Clipboard, Clipboard]) -> None:
    one, other = two
    assert one.copy("/takes/Müller 走る")
    assert paste(other, one) == "/takes/Müller 走る"
    assert paste(one, one) == "/takes/Müller 走る"
    assert other.copy("second")
    assert paste(one, other) == "second"
    one.close()
    assert paste(other, other) == "second", "one that has gone changes nothing"


def test_a_path_that_is_not_utf8_is_copied(two: tuple[Clipboard, Clipboard]) -> None:
    """Bytes of a name that are no UTF-8 go as they are; who reads them as text sees a replacement character."""
    one, other = two
    assert one.copy(os.fsdecode(b"/takes/M\xfcller"))
    assert paste(other, one) == "/takes/M\N{REPLACEMENT CHARACTER}ller"


def test_an_empty_clipboard_is_empty(two: tuple[Clipboard, Clipboard]) -> None:
    one, other = two
    assert one.copy("text")
    one.close()
    assert paste(other, other) == ""


def test_without_x_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    none = Clipboard()
    assert not none.copy("text")
    assert not none.ask()
    assert none.poll() is None
