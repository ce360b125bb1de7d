"""The scene of a real take: what is in it, resolution at rest, clicks on cameras and on the view axes."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gui.models.loop import LOOP
from gui.models.playback.player import PlayerPresenter
from gui.models.scene.contents import SceneWanted
from gui.models.scene.orbit import OrbitCamera
from gui.models.scene.reader import SceneReader
from gui.models.scene.rest import RESTS_AFTER
from gui.models.take.workspace import Workspace
from gui.pages.stage_views import StageViews
from gui.widgets.raycast import RaycastMesh
from pipelines.takes.take import Take
from studio.camera_files import read_rig
from tests.support.looping import heard
from tests.support.waiting import wait_until

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
        pictures: list[np.ndarray] = []

        def there() -> bool:
            LOOP.run()
            new = self.views.poll(FULL, DRAWN, 14.0)
            pictures.extend([] if new is None else [new])
            right = (FULL if rests else DRAWN)[::-1]
            return bool(pictures) and self.views.settled and pictures[-1].shape[:2] == right

        wait_until("a picture of the scene", there)
        return pictures[-1]

    def show(self, *parts: str) -> None:
        """Show these parts only."""
        for part in self.player.scene_parts ^ set(parts):
            self.views.choose(part)


@pytest.fixture
def scene(finished_project: Path) -> Iterator[Scene]:
    """The finished take."""
    found = Scene(finished_project / "take")
    yield found
    assert found.views.close()
    assert found.workspace.close()


def test_cameras_can_be_clicked(scene: Scene, finished_project: Path) -> None:
    rig = read_rig(Take.open(finished_project / "take").rig)
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


def test_the_camera_in_whose_place_the_view_is_does_not_cover_it(scene: Scene) -> None:
    rig = scene.player.opened.rig if scene.player.opened is not None else None
    first = next(iter(rig))
    scene.player.orbit = OrbitCamera.looking_through(first, np.zeros(3), rig.up)
    scene.picture(rests=True)
    found = scene.player.picture
    assert first.name not in {name for name, _ in found.cameras}


def test_frusta_have_the_images_of_the_frame_once_the_view_rests(scene: Scene) -> None:
    context = scene.workspace.context
    assert context is not None
    rig = scene.player.opened.rig if scene.player.opened is not None else None
    assert rig is not None
    reader, first = SceneReader(RaycastMesh), next(iter(rig)).name

    def image(frame: int, still: bool) -> np.ndarray | None:
        wanted = SceneWanted(
            context.take, context, rig, "", 0, frozenset({"cameras"}), rig.up, np.zeros((0, 3)), still, 14.0
        )
        return next(one.image for one in reader.read(wanted, frame).cameras if one.camera.name == first)

    def footage(frame: int, like: np.ndarray) -> np.ndarray:
        raw = context.footage.raw
        return cv2.resize(raw.raw_image(first, raw.frames[frame]), like.shape[1::-1], interpolation=cv2.INTER_AREA)

    assert image(0, still=False) is None
    resting = image(0, still=True)
    assert resting is not None
    assert (resting == footage(0, resting)).all()
    moving = image(1, still=False)
    assert moving is not None
    assert (moving == resting).all()  # the last one that was read
    later = image(1, still=True)
    assert later is not None
    assert (later == footage(1, later)).all()
    assert (later != resting).any()
