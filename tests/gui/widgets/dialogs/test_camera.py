"""The list of cameras has no column without a value."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from open3d.visualization import gui

from gui.models.take.cameras import CameraUses
from gui.widgets.dialogs.camera import ask_cameras


@pytest.mark.parametrize(("figures", "column"), [({}, False), ({"a": "31.20 dB"}, True)])
def test_psnr_has_a_column_once_there_is_one(figures: dict[str, str], column: bool) -> None:
    words: list[str] = []

    def label(text: str, dim: bool = True) -> gui.Label:
        words.append(text)
        return gui.Label(text)

    dialogs: Any = SimpleNamespace(em=16, widgets={}, label=label, show=lambda *_: None, close=lambda: None)
    ask_cameras(dialogs, CameraUses({"a": "training", "b": "held out"}), figures, lambda _: "")
    assert ("PSNR" in words) == column
    assert ("-" in words) == column, "of the camera without one"
    assert {"a", "b"} < set(words)
