from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.support.streams import bake_numbered
from v3studio.gui.actions.path import PathActions
from v3studio.gui.models.history import History
from v3studio.gui.models.loop import Signal
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.take.exports import Exports

NUKE = "Camera3 {\n inputs 0\n translate {{curve x1 1 2 3 4} 0 30}\n name %s\n}\n"


class Window:
    """What the actions use of the main window; its dialog keeps what can be answered."""

    def __init__(self, stream: Path) -> None:
        self.player, self.notices, self.exports = PlayerPresenter(), Notices(), Exports()
        self.player.opened = SimpleNamespace(path=stream, sources={"decoded": None}, take=None)  # type: ignore[assignment]
        self.exports.path.open(None, History())
        self.dialogs, self.path_panel = SimpleNamespace(choose=self._choose), SimpleNamespace(shown=True)
        self.changed: Signal[[]] = Signal()

    def _choose(self, name: str, title: str, choices: Sequence[str], chosen: Callable[[str], object]) -> None:
        self.choices, self.chosen = choices, chosen


def test_a_camera_of_a_film_tool_becomes_the_path(tmp_path: Path) -> None:
    window = Window(bake_numbered(tmp_path / "stream", (6,), 25))
    actions = PathActions(window, lambda: None)  # type: ignore[arg-type]
    file = tmp_path / "shot.nk"
    file.write_text(NUKE % "first" + NUKE.replace("30", "40") % "second")
    actions.read(str(file))
    assert window.choices == ["first", "second"]
    window.chosen("second")
    path = window.exports.path
    assert [key.frame for key in path.keys] == [1, 2, 3, 4]
    cameras = [path.path(640, 360).camera(seconds) for seconds in (0, path.duration)]
    assert np.linalg.norm(cameras[1].center - cameras[0].center) == pytest.approx(3)
    file.write_text("Blur {\n size 3\n}\n")
    actions.read(str(file))
    assert "no node Camera2" in window.notices.text
    assert len(path.keys) == 4, "kept"
