"""The dialog of a new take keeps its size while one types: its summary has always the same."""

from __future__ import annotations

import pytest

from gui.drawing.canvas import text_width
from gui.widgets.dialogs.take import _found


@pytest.mark.parametrize("room", [400.0, 900.0])
def test_the_summary_has_one_size(room: float) -> None:
    texts = (
        "Choose the footage folder.",
        "Footage 'videos/{camera}.mp4' in /a/path/to/the/footage: 16 cameras, 30 frames (0 to 29), 640x360.\nMasks.",
        "many words " * 200,
    )
    shown = [_found(text, 16.0, room) for text in texts]
    sizes = {(len(one.split("\n")), max(text_width(line, 16) for line in one.split("\n"))) for one in shown}
    assert len({lines for lines, _ in sizes}) == 1
    widths = [width for _, width in sizes]
    assert max(widths) - min(widths) <= 0.01 * room
    assert max(widths) <= room
