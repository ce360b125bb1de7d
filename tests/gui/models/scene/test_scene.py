"""The scene of a real take: what is in it, resolution at rest, clicks on cameras and on the view axes."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gui.models.playback.player import PlayerPresenter
from gui.models.scene.rest import RESTS_AFTER
from gui.models.take.workspace import Workspace
from gui.pages.stage_views import StageViews
from gui.widgets.raycast import RaycastMesh
from pipelines.takes.take import Take
from studio.camera_files import read_rig
from tests.support.looping import heard
from tests.support.players import newest

FULL, DRAWN = (720, 500), (360, 250)


class Scene:
    """Stage views of a take, with a clock that is set by hand."""

    def __init__(self, take: Path) -> None:
        self.clock = 100.0
        self.workspace = Workspace()
        self.player = PlayerPresenter(now=lambda: self.clock, read_mesh=RaycastMesh)
        self.views = StageViews(self.workspace, self.player, RaycastMesh)
        assert self.player.open(take), self.player.message
        self.workspace.open(Take.open(take))
        self.player.transport.pause()
        self.views.choose("scene")

    def picture(self, rests: bool = False) -> np.ndarray:
        """The newest picture, at rest or not."""
        self.views.show_again()
        self.views.poll(FULL, DRAWN, 14.0)
        self.clock += 2 * RESTS_AFTER if rests else 0.0
        right = (FULL if rests else DRAWN)[::-1]
        poll, settled = lambda: self.views.poll(FULL, DRAWN, 14.0), lambda: self.views.settled
        return newest(poll, settled, lambda picture: picture.shape[:2] == right)

    def show(self, *parts: str) -> None:
        """Show these parts only."""
        for part in self.player.scene_parts ^ set(parts):
            self.views.choose(part)


@pytest.fixture
def scene(finished: Path) -> Iterator[Scene]:
    """The finished take."""
    found = Scene(finished / "take")
    yield found
    assert found.views.close()
    assert found.workspace.close()


def test_cameras_can_be_clicked(scene: Scene, finished: Path) -> None:
    rig = read_rig(Take.open(finished / "take").rig)
    scene.show("splats", "cameras")
    scene.player.orbit = scene.player.orbit.zoom(-14).orbit(120, 120)
    scene.picture()
    found = scene.player.picture
    names = [name for name, _ in found.cameras]
    assert set(names) == {camera.name for camera in rig}
    view = scene.player.orbit.camera(*DRAWN)
    for name, corners in found.cameras:
        center, _ = view.project(rig[name].center[None])
        assert np.abs(corners[0] - center[0]).max() < 1e-6
    name, corners = found.cameras[-1]
    clicked, menus = heard(scene.views.camera_clicked), heard(scene.views.camera_menu)
    scene.views.click(*corners.mean(axis=0))
    scene.views.context(*corners.mean(axis=0))
    scene.views.click(1, 249)
    assert (clicked, menus) == ([(name,)], [(name,)])
    axis = dict(found.ends)["+x"]
    scene.views.click(*axis.mean(axis=0))
    assert scene.player.orbit.offset[0] > 0.999
