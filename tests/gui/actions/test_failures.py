"""A failure that is shown goes once the same succeeds; others stay."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gui.actions import notices as notices_module
from gui.actions.commands import Actions
from gui.actions.help import HelpActions
from gui.actions.notices import NoticeKeys
from gui.actions.path import PathActions
from gui.models.notices import Notices
from gui.models.take.remedies import Fix
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


def test_settings(notices: Notices) -> None:
    refusals = ["settings are locked during a run", None]
    workspace = SimpleNamespace(change_settings=lambda _: refusals.pop(0), config=None)
    stages = SimpleNamespace(show_setting=lambda _: None)
    window: Any = SimpleNamespace(notices=notices, workspace=workspace, stages=stages)
    help_actions = HelpActions(window)
    fix: Any = SimpleNamespace(sets=True, done=False, setting="bake.quality", value=30)
    assert {"sets", "done", "setting", "value"} <= set(dir(Fix)) | set(Fix.__dataclass_fields__)
    help_actions.apply_fix(fix)
    assert failure(notices) == "settings are locked during a run"
    workspace.config = object()
    help_actions.apply_fix(fix)
    assert failure(notices) == ""
    workspace.config = None
    help_actions._show("bake.quality")
    assert failure(notices).startswith("Only a take has settings.")
    workspace.config = object()
    help_actions._show("bake.quality")
    assert failure(notices) == ""


def test_camera_path(notices: Notices) -> None:
    window: Any = SimpleNamespace(notices=notices, changed=lambda: None)
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
