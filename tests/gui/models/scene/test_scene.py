from pathlib import Path

import numpy as np

from tests.support.looping import heard
from tests.support.players import newest
from v3studio.gui.models.playback.sources import load
from v3studio.gui.pages.stage_views import StageViews
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig

DRAWN = (360, 250)


def test_cameras_can_be_clicked(views: StageViews, finished: Path) -> None:
    player, take = views.player, Take.open(finished / "take")
    rig = read_rig(take.rig)
    player.adopt(*load(take.root))
    views.workspace.open(take)
    player.transport.pause()
    views.choose("scene")
    for part in player.scene_parts ^ {"splats", "cameras"}:
        views.choose(part)
    player.orbit = player.orbit.zoom(-14).orbit(120, 120)
    newest(lambda: views.poll(DRAWN, DRAWN, 14.0), lambda: views.settled)
    scene = player.picture
    names = [name for name, _ in scene.cameras]
    assert set(names) == {camera.name for camera in rig}
    view = player.orbit.camera(*DRAWN)
    for name, corners in scene.cameras:
        center, _ = view.project(rig[name].center[None])
        assert np.abs(corners[0] - center[0]).max() < 1e-6
    name, corners = scene.cameras[-1]
    clicked, menus = heard(views.camera_clicked), heard(views.camera_menu)
    views.click(*corners.mean(axis=0))
    views.context(*corners.mean(axis=0))
    views.click(1, 249)
    assert (clicked, menus) == ([(name,)], [(name,)])
    axis = dict(scene.ends)["+x"]
    views.click(*axis.mean(axis=0))
    assert player.orbit.offset[0] > 0.999
