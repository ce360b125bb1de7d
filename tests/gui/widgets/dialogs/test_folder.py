"""The folder dialog names what is selected: the toolkit draws the selected row gray on gray."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from open3d.visualization import gui

from gui.models.folders import FolderList
from gui.widgets.dialogs.folder import _PathDialog


def test_what_is_selected_is_named(tmp_path: Path) -> None:
    (tmp_path / "walk").mkdir()
    dialogs: Any = SimpleNamespace(label=gui.Label)
    dialog = _PathDialog(dialogs, FolderList(tmp_path, "folder"), lambda _: None, lambda: None)
    dialog._fill()
    assert not dialog._selected.text.strip()
    dialog._list.selected_index = 0
    dialog._select("", False)
    assert "walk" in dialog._selected.text
    dialog._type(str(tmp_path))
    assert not dialog._selected.text.strip(), "what is typed counts"
