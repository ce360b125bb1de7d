import json
from pathlib import Path

import numpy as np
import torch

from tests.support.players import settle
from tests.support.streams import bake_numbered
from v3studio.gui.models.playback.player import PlayerPresenter
from v3studio.gui.models.playback.sources import load
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.widgets.raycast import RaycastMesh
from v3studio.studio.formats import ply
from v3studio.studio.gaussians import Gaussians

BLUE = torch.tensor([[[-1.77, -1.77, 1.77]]])


def test_splats_are_over_the_ground(tmp_path: Path) -> None:
    bake_numbered(tmp_path / "walk", [2], 25.0)
    unit = torch.tensor([[1.0, 0, 0, 0]])
    ball = Gaussians(torch.zeros(1, 3), unit, torch.full((1, 3), -1.5), torch.tensor([9.0]), BLUE)
    ply.write(tmp_path / "ball.ply", ball)
    items = [
        {"stream": "walk", "position": [0, 0, -500]},
        {"splats": "ball.ply", "position": [0, 0.6, 0]},
    ]
    document = {"format": "v3studio-cast", "version": 1, "ground": {"color": [0, 0.9, 0]}, "items": items}
    (tmp_path / "cast.json").write_text(json.dumps(document))
    player = PlayerPresenter(read_mesh=RaycastMesh)
    player.adopt(*load(tmp_path / "cast.json"))
    assert player.mode == "scene"
    player.scene_parts = frozenset({"splats"})
    player.background = "black"
    player.resize(320, 240)
    player.orbit = OrbitCamera.from_to(np.array([0, 0.6, 4]), np.array([0, 0.6, 0]), np.array([0, 1.0, 0]), 0.6)

    settle(player)
    view = player.orbit.camera(320, 240)
    column, row = view.project(np.array([[0.5, 0, 0.5]]))[0][0].astype(int)
    assert player.picture.image[row, column].tolist() == [0, 230, 0]
    column, row = view.project(np.array([[0, 0.6, 0]]))[0][0].astype(int)
    red, _, blueness = player.picture.image[row, column].astype(int)
    assert blueness > 60 + 2 * red
    assert player.close()
