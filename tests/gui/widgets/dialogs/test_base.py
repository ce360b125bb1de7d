from pathlib import Path

import pytest

from v3studio.gui.models.folders import FolderList


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
    listed = FolderList(tree, "folder")
    assert [entry.label for entry in listed.entries] == ["a take/   (take)", "cam2/", "cam10/", "Stream/   (stream)"]
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

    with_files = FolderList(tree, "take", (".yaml",))
    assert with_files.entries[-1].path == tree / "run.yaml"
    assert with_files.choose(tree / "run.yaml") == tree / "run.yaml"
    assert with_files.choose(tree / "notes.txt") is None

    files = FolderList(tree, "file", (".yaml",))
    assert files.choose(tree / "run.yaml") == tree / "run.yaml"
    assert files.choose(tree / "cam2") is None
    assert files.folder == tree / "cam2"
