"""The timeline: values under the pointer."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from open3d.visualization import gui

from gui.models.playback.timeline_plots import plots_of
from gui.models.playback.transport import Transport
from gui.widgets.timeline import TimelinePanel


@pytest.mark.parametrize(("pointer", "covered"), [((500, 300), False), ((500, 650), True)])
def test_values_vanish_when_the_pointer_has_left(pointer: tuple[int, int], covered: bool) -> None:
    opened = SimpleNamespace(trim=None, default=None)
    player: Any = SimpleNamespace(transport=Transport(4, 25.0), frame=0, opened=opened)
    panel = TimelinePanel(player, 16.0, lambda: None)
    panel.picture.place(300, 600, 900, 160)
    panel.plots = plots_of({"psnr_trained": [30.0, 31.0, 32.0, 33.0]})
    shown: list[np.ndarray] = []
    panel.picture.show = shown.append  # type: ignore[method-assign]
    panel.update()
    move: Any = SimpleNamespace(type=gui.MouseEvent.Type.MOVE, is_button_down=lambda _: False)
    panel._on_mouse(move, 500.0, 50.0)
    panel.look((800, 650), False)
    panel.update()
    assert not np.array_equal(shown[0], shown[-1]), "the values"
    panel.look(pointer, covered)
    panel.update()
    assert np.array_equal(shown[0], shown[-1])
    panel.filmstrip.close()
