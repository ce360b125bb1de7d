from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from tests.support.streams import bake_numbered
from v3studio.gui.actions.path import PathActions
from v3studio.gui.models.camera_path import PathEditor
from v3studio.gui.models.notices import Notices
from v3studio.gui.models.playback.player import PlayerPresenter

NUKE = "Camera3 {\n inputs 0\n translate {{curve x1 1 2 3 4} 0 30}\n name %s\n}\n"


def test_a_camera_of_a_film_tool_becomes_the_path(tmp_path: Path) -> None:
    player, path, notices, dialogs = PlayerPresenter(), PathEditor(), Notices(), MagicMock()
    stream = bake_numbered(tmp_path / "stream", (6,), 25)
    player.opened = SimpleNamespace(path=stream, sources={"decoded": None}, take=None)  # type: ignore[assignment]
    actions = PathActions(player, MagicMock(), path, MagicMock(), dialogs, notices, lambda: None)
    file = tmp_path / "shot.nk"
    file.write_text(NUKE % "first" + NUKE.replace("30", "40") % "second")
    actions.read(str(file))
    _, _, names, chosen = dialogs.choose.call_args.args
    assert names == ["first", "second"]
    chosen("second")
    assert [key.frame for key in path.keys] == [1, 2, 3, 4]
    cameras = [path.path(640, 360).camera(seconds) for seconds in (0, path.duration)]
    assert np.linalg.norm(cameras[1].center - cameras[0].center) == pytest.approx(3)
    file.write_text("Blur {\n size 3\n}\n")
    actions.read(str(file))
    assert "no node Camera2" in notices.text
    assert len(path.keys) == 4, "kept"
