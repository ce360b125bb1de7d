"""A failure that is shown goes once the same succeeds; others stay."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gui.actions import cameras as cameras_module
from gui.actions import edits as edits_module
from gui.actions import notices as notices_module
from gui.actions import shares as shares_module
from gui.actions.bakes import BakeActions
from gui.actions.cameras import CameraActions
from gui.actions.commands import Actions
from gui.actions.edits import EditActions
from gui.actions.help import HelpActions
from gui.actions.notices import NoticeKeys
from gui.actions.path import PathActions
from gui.actions.shares import ShareActions
from gui.models.notices import Notices
from gui.models.preferences import Preferences
from gui.models.take.remedies import Fix
from studio.edits.edit_list import EditList
from studio.errors import StudioError


@pytest.fixture
def notices() -> Notices:
    found = Notices()
    found.tell("another failure", bad=True, topic="another")
    return found


def failure(notices: Notices) -> str:
    """The failure in front; "" if only the one that has nothing to do with it is left."""
    assert notices.more == (notices.card is not None and notices.card.text != "another failure")
    return "" if notices.card is None or notices.card.topic == "another" else notices.card.text


def full(*_: object) -> Any:
    raise StudioError("disk.full", "the disk is full")


def test_bakes(notices: Notices) -> None:
    window: Any = SimpleNamespace(
        notices=notices, workspace=SimpleNamespace(take=None), dialogs=SimpleNamespace(name="", em=16)
    )
    actions = BakeActions(window)
    bakes: Any = SimpleNamespace(message="the disk is full", failed=True, poll=lambda: True)
    actions.bakes = bakes
    actions.poll()
    assert failure(notices) == "the disk is full"
    bakes.message, bakes.failed = "Kept as 'a'.", False
    actions.poll()
    assert (failure(notices), notices.line) == ("", "Kept as 'a'.")


def test_settings(notices: Notices) -> None:
    refusals = ["settings are locked during a run", None]
    workspace = SimpleNamespace(change_settings=lambda _: refusals.pop(0), config=None)
    stages = SimpleNamespace(show_setting=lambda _: None)
    window: Any = SimpleNamespace(notices=notices, workspace=workspace, stages=stages)
    help_actions = HelpActions(window)
    fix: Any = SimpleNamespace(sets=True, done=False, setting="bake.qp", value=30)
    assert {"sets", "done", "setting", "value"} <= set(dir(Fix)) | set(Fix.__dataclass_fields__)
    help_actions.apply_fix(fix)
    assert failure(notices) == "settings are locked during a run"
    workspace.config = object()
    help_actions.apply_fix(fix)
    assert failure(notices) == ""
    workspace.config = None
    help_actions._show("bake.qp")
    assert failure(notices).startswith("Only a take has settings.")
    workspace.config = object()
    help_actions._show("bake.qp")
    assert failure(notices) == ""


def test_cameras_and_garbage_masks(notices: Notices, monkeypatch: pytest.MonkeyPatch) -> None:
    garbage = SimpleNamespace(refused="", stamp=1)
    views = SimpleNamespace(capture=SimpleNamespace(garbage=garbage), asked=None, pressed=False)
    context = SimpleNamespace(footage=SimpleNamespace(capture=None))
    workspace = SimpleNamespace(context=context)
    window: Any = SimpleNamespace(
        notices=notices, views=views, camera_menu=SimpleNamespace(camera=""), workspace=workspace
    )
    actions = CameraActions(window)
    garbage.refused = "settings are locked during a run"
    actions.poll()
    actions.poll()
    assert failure(notices) == "settings are locked during a run"
    garbage.stamp = 2
    actions.poll()
    assert failure(notices) == ""

    monkeypatch.setattr(cameras_module.CameraUses, "of", full)
    assert actions._uses() is None
    assert failure(notices).startswith("the disk is full")
    uses: Any = SimpleNamespace(with_use=lambda *_: None)
    monkeypatch.setattr(cameras_module.CameraUses, "of", lambda _: uses)
    refusals = ["refused", ""]
    monkeypatch.setattr(cameras_module, "change_uses", lambda *_: refusals.pop(0))
    actions._use("cam0", "training")
    assert failure(notices) == "refused"
    actions._use("cam0", "training")
    assert (failure(notices), notices.line) == ("", "Train on cam0: Ctrl+Z takes it back.")


def test_edits(notices: Notices, monkeypatch: pytest.MonkeyPatch) -> None:
    editor = SimpleNamespace(refused="edits are locked during a run", distance_asked=None, tool="crop")
    window: Any = SimpleNamespace(
        notices=notices, workspace=None, views=SimpleNamespace(editor=editor, asked_edit=""),
        player=SimpleNamespace(refresh=lambda: None),
    )  # fmt: skip
    edits = EditList()
    monkeypatch.setattr(edits_module, "edits_of", lambda _: edits)
    actions = EditActions(window)
    actions.poll()
    actions.poll()
    assert failure(notices) == "edits are locked during a run"
    edits = "other edits"  # type: ignore[assignment]
    actions.poll()
    assert failure(notices) == ""


def test_camera_path(notices: Notices) -> None:
    window: Any = SimpleNamespace(notices=notices)
    actions = PathActions(window, lambda: None)
    assert not actions._done(full)
    assert failure(notices).startswith("the disk is full")
    assert actions._done(lambda: None)
    assert failure(notices) == ""


def test_preferences(notices: Notices) -> None:
    actions: Any = Actions.__new__(Actions)
    actions._window = SimpleNamespace(notices=notices, apply_preferences=lambda: None)
    actions._save_preferences(SimpleNamespace(save=lambda: False))
    assert failure(notices).startswith("Preferences could not be saved")
    actions._save_preferences(SimpleNamespace(save=lambda: True))
    assert failure(notices) == ""


def test_copying_and_showing_a_folder(notices: Notices, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clipboard: Any = SimpleNamespace(copy=lambda _: False)
    window: Any = SimpleNamespace(notices=notices)
    keys = NoticeKeys(window, clipboard)
    keys.copy()
    assert failure(notices) == "There is no clipboard to copy to."
    clipboard.copy = lambda _: True
    keys.copy()
    assert failure(notices) == ""

    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: None)
    monkeypatch.setattr(notices_module, "show_folder", lambda _: "no such folder")
    notices.tell("Written: a.png", path=tmp_path / "a.png")
    keys.open_folder()
    assert failure_behind(notices) == ["another failure", "no such folder"]
    notices.tell("Written: a.png", path=tmp_path / "a.png")
    monkeypatch.setattr(notices_module, "show_folder", lambda _: "")
    keys.open_folder()
    assert failure_behind(notices) == ["another failure"]


def failure_behind(notices: Notices) -> list[str]:
    return [one.text for one in notices._failures]


def test_sharing_and_serving(notices: Notices, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    serving = SimpleNamespace(poll=lambda: True, failure="the port is taken", address="", source="")
    opened = SimpleNamespace(path=tmp_path, title="a")
    window: Any = SimpleNamespace(
        notices=notices, serving=serving, dialogs=SimpleNamespace(name="other", widgets={}),
        exports=SimpleNamespace(share=None),
        player=SimpleNamespace(opened=opened), preferences=Preferences(), workspace=SimpleNamespace(take=None),
    )  # fmt: skip
    actions = ShareActions(window)
    actions.poll()
    assert failure(notices) == "the port is taken"
    serving.address = "http://host:8000"
    actions.poll()
    assert failure(notices) == ""

    monkeypatch.setattr(shares_module, "share_size", full)
    actions.ask("folder")
    assert failure(notices).startswith("the disk is full")
    size = SimpleNamespace(single_file_possible=False)
    monkeypatch.setattr(shares_module, "share_size", lambda _: size)
    monkeypatch.setattr(shares_module, "share_words", lambda *_: "too large for a single file")
    monkeypatch.setattr(shares_module, "ask_share", lambda *_: None)
    actions.ask("folder")
    assert failure(notices) == ""
    actions.ask("single-file")
    assert failure(notices) == "too large for a single file"
    actions.ask("folder")
    assert failure(notices) == "too large for a single file"
    size.single_file_possible = True
    actions.ask("single-file")
    assert failure(notices) == ""
