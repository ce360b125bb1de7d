"""The real window with texts of double size, as on a dense screen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from scripts.screens import menu, take_picture, x_server
from tests.gui.conftest import RunningWindow

TEXT = 40
"""Least difference of text from the dialog's background, of 255 levels."""


def test_labels_of_a_dialog_are_beside_their_fields(tmp_path: Path, take_copy: Path, artifacts: Path) -> None:
    """A label that the toolkit breaks takes two lines, and all labels below it are a line too low."""
    with x_server("2560x1600", 2.0) as display:
        window = RunningWindow(display, tmp_path / "state.jsonl", str(take_copy), "--size", "1280x800")
        try:
            window.wait_for("the take", lambda s: s["frames"] > 1 and not s["opening"])
            menu("File", "preferences")(window)
            picture = artifacts / "dense_preferences.png"
            take_picture(window, picture)  # once it is drawn, which takes a while at this size
            fields = [window.inside(f"dialog {name}") for name in ("picture_size", "background", "play")]
        finally:
            window.close()
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    left = min(columns.start for _, columns in fields)
    for rows, _ in fields:
        height = rows.stop - rows.start
        beside = pixels[rows.start - height : rows.stop + height, left - 8 * height : left - height // 4]
        background = np.median(beside.reshape(-1, 3), axis=0)
        text = (np.abs(beside - background).max(axis=2) > TEXT).any(axis=1)
        inside = text[height : 2 * height]
        assert inside.any(), "no label beside the field"
        first, last = np.flatnonzero(inside)[[0, -1]]
        assert abs((first + last) / 2 - height / 2) < 0.25 * height
