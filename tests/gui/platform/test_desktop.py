"""Folders are shown by the desktop, or it is told why not."""

from __future__ import annotations

from pathlib import Path

import pytest

from gui.platform.desktop import show_folder
from tests.support.waiting import wait_until


def test_the_folder_of_a_file_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program, told = tmp_path / "xdg-open", tmp_path / "told"
    program.write_text(f'#!/bin/sh\nprintf %s "$1" > "{told}"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    written = tmp_path / "my takes" / "walk.mp4"
    written.parent.mkdir()
    written.touch()
    assert show_folder(written) == ""
    wait_until("the folder", lambda: told.exists() and told.read_text() == str(written.parent))


def test_what_cannot_be_shown_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "no such folder" in show_folder(tmp_path / "gone" / "walk.mp4")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "xdg-utils" in show_folder(tmp_path)
