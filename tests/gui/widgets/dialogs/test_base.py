"""Dialogs: the list of folders, the Enter key, and missing entries in the recent list."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from gui.models.folders import FolderList
from gui.models.preferences import Preferences


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Two plain folders, a take, a stream, files, and a hidden entry."""
    for name in ("cam10", "cam2", "a take", "Stream", ".hidden"):
        (tmp_path / name).mkdir()
    (tmp_path / "a take" / "take.json").write_text("{}")
    (tmp_path / "Stream" / "manifest.json").write_text("{}")
    for name in ("run.yaml", "notes.txt"):
        (tmp_path / name).write_text("")
    (tmp_path / "cam2" / "inner").mkdir()
    return tmp_path


def test_folders_are_listed_with_what_they_are(tree: Path) -> None:
    found = FolderList(tree, "folder")
    assert [entry.label for entry in found.entries] == ["a take/   (take)", "cam2/", "cam10/", "Stream/   (stream)"]
    assert [entry.path.name for entry in FolderList(tree, "file", (".yaml",)).entries][-1] == "run.yaml"
    assert len(FolderList(tree, "file", (".yaml",)).entries) == 5
    assert FolderList(tree / "not" / "there", "folder").folder == tree, "the nearest one that is there"


def test_what_is_marked_is_what_is_chosen(tree: Path) -> None:
    any_folder = FolderList(tree, "folder")
    assert any_folder.choose(tree / "cam2") == tree / "cam2"
    assert any_folder.choose(tree) == tree, "the folder one is in, without a mark"
    assert any_folder.choose(tree / "cam2", twice=True) is None
    assert any_folder.folder == tree / "cam2"
    any_folder.up()
    assert any_folder.choose(Path("cam10")) == tree / "cam10", "typed, relative to where one is"

    takes = FolderList(tree, "take")
    assert takes.choose(tree / "a take", twice=True) == tree / "a take"
    assert takes.choose(tree / "Stream") == tree / "Stream"
    assert takes.choose(tree / "cam2") is None
    assert takes.folder == tree / "cam2", "a plain folder is gone into"
    assert takes.message == ""
    assert takes.choose(tree / "cam2") is None
    assert "neither a take nor a stream" in takes.message

    files = FolderList(tree, "file", (".yaml",))
    assert files.choose(tree / "run.yaml") == tree / "run.yaml"
    assert files.choose(tree / "cam2") is None
    assert files.folder == tree / "cam2"


def test_what_cannot_be_had_is_a_sentence(tree: Path) -> None:
    found = FolderList(tree, "take")
    assert found.choose(tree / "gone") is None
    assert "gone: no such folder" in found.message
    assert found.choose(tree / "notes.txt") is None
    assert "not a folder" in found.message
    assert not found.enter(tree / "notes.txt")
    assert found.folder == tree
    assert "cannot be read" in found.message
    assert found.entries


def test_recent_ones_that_are_gone(tree: Path) -> None:
    there, gone, address = str(tree / "a take"), str(tree / "gone"), "https://example.org/walk"
    assert Preferences(recent=[gone, there, address]).recent_there() == [there, address]


def test_a_marked_folder_is_opened_and_enter_confirms(
    open_window: Callable, take_copy: Path, tmp_path: Path, artifacts: Path
) -> None:
    settings = tmp_path / "config" / "v3studio"
    settings.mkdir(parents=True)
    (settings / "window.json").write_text(json.dumps({"recent": [str(take_copy)]}))
    window = open_window("--size", "1100x760")
    window.wait_for("an empty window", lambda s: s["dialog"] == "" and s["message"])

    # the list starts next to the newest take: select the take, press Open
    window.menu("File", "open")
    window.wait_for("the folders", lambda s: s["dialog"] == "path")
    names = [entry.path.name for entry in FolderList(take_copy.parent, "take").entries]
    row = 0.011 + (names.index("take") + 0.5) / 14
    window.click("dialog list", 0.2, row)
    window.screenshot(artifacts / "dialog_path.png")
    window.click("dialog open")
    state = window.wait_for("the take", lambda s: s["frames"] > 1 and s["dialog"] == "" and s["opening"] == "")
    assert state["title"].startswith("take ")

    window.key("Home")
    window.wait_for("the first frame", lambda s: s["shown"] == 0)
    window.key("m")
    window.wait_for("the question", lambda s: s["dialog"] == "mark")
    window.wait_for("a line with the keyboard", lambda s: s["typing"])
    window.enter_text("dialog line", "by enter")
    window.key("Return")
    window.wait_for("the mark", lambda s: s["marks"] == {"0": "by enter"} and s["dialog"] == "")

    # losing the keyboard focus does not confirm
    window.key("m")
    window.wait_for("the question", lambda s: s["dialog"] == "mark")
    window.wait_for("a line with the keyboard", lambda s: s["typing"])
    window.enter_text("dialog line", "more", selected=True)  # Tab selects the text of the field that it focuses
    window.click("dialog line", 0.5, -1.0)
    assert window.states()[-1]["dialog"] == "mark"
    window.click("dialog close")
    state = window.wait_for("no dialog", lambda s: s["dialog"] == "")
    assert state["marks"] == {"0": "by enter"}

    # one Escape closes it, although the field that is typed into keeps the key to itself
    window.key("m")
    window.wait_for("a line with the keyboard", lambda s: s["dialog"] == "mark" and s["typing"])
    window.enter_text("dialog line", "more", selected=True)
    window.key("Escape")
    state = window.wait_for("no dialog", lambda s: s["dialog"] == "")
    assert state["marks"] == {"0": "by enter"}
    assert window.close() == 0, window.stderr.read_text()[-2000:]
    assert "top-level" not in window.stderr.read_text()
