"""Folders and pages are shown by the desktop, or it is told why not."""

from pathlib import Path

import pytest

from gui.platform.desktop import PageOpener, show_folder
from tests.support.waiting import wait_until


def test_what_cannot_be_shown_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "no such folder" in show_folder(tmp_path / "gone" / "walk.mp4")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "xdg-utils" in show_folder(tmp_path)


def test_a_page_is_opened_without_waiting_and_failure_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, told, end, ended = (tmp_path / name for name in ("xdg-open", "told", "end", "ended"))
    program.write_text(
        f'#!/bin/sh\nprintf %s "$1" > "{told}"\nwhile [ ! -e "{end}" ]; do sleep 0.02; done\ncp "{end}" "{ended}"\n'
        f'exit $(cat "{end}")\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    page = tmp_path / "walk.html"
    pages = PageOpener()
    assert str(page) in pages.open(page), "there is no such file"
    page.touch()
    assert pages.open(page) == ""
    wait_until("the page", lambda: told.exists() and told.read_text() == str(page))
    assert pages.failure() == "", "the browser is still starting"
    (tmp_path / "new end").write_text("3")
    (tmp_path / "new end").rename(end)
    failures: list[str] = []
    wait_until("the failure", lambda: bool(failures.append(pages.failure()) or failures[-1]))
    assert str(page) in failures[-1]
    assert pages.failure() == ""
    end.write_text("0")
    assert pages.open(page) == ""
    wait_until("its end", lambda: ended.read_text() == "0")
    assert pages.failure() == ""
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    assert "xdg-utils" in pages.open(page)
