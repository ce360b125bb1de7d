"""Pictures of the player at full resolution once the view rests, unless they would take long; labels of one size."""

import time
from pathlib import Path

import numpy as np
import pytest

from gui.models.loop import LOOP
from gui.models.playback import player as player_module
from gui.models.playback.player import PlayerPresenter
from gui.models.scene.render import no_mesh
from gui.models.scene.rest import RESTS_AFTER
from gui.models.take.workspace import Workspace
from gui.pages.stage_views import StageViews
from pipelines.takes.take import Take
from studio.cameras import Camera
from studio.gaussians import Gaussians
from tests.support.waiting import wait_until

FULL, DRAWN = (720, 500), (360, 250)


class Views:
    """Stage views of a take in Review, with a clock that is set by hand."""

    def __init__(self, take: Path) -> None:
        self.clock, self.seconds, self.drawn = 100.0, 0.0, 0
        self.workspace = Workspace()
        self.player = PlayerPresenter(self.draw, now=lambda: self.clock)
        self.views = StageViews(self.workspace, self.player, no_mesh)
        assert self.player.open(take), self.player.message
        self.workspace.open(Take.open(take))
        self.player.transport.pause()
        self.views.select("review")

    def draw(self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float]) -> np.ndarray:
        time.sleep(self.seconds)
        self.drawn += 1
        return np.full((camera.height, camera.width, 3), 90, np.uint8)

    def picture(self) -> np.ndarray:
        """The newest picture, once all is drawn."""
        pictures: list[np.ndarray] = []

        def there() -> bool:
            LOOP.run()
            for _ in range(3):  # a picture may lead to another request
                new = self.views.poll(FULL, DRAWN, 20.0)
                pictures.extend([] if new is None else [new])
            return bool(pictures) and self.views.settled

        wait_until("a picture", there)
        return pictures[-1]


@pytest.fixture
def views(finished_project: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(player_module, "LONGEST_SHARP", 600.0)  # no picture takes that long, on any machine
    found = Views(finished_project / "take")
    yield found
    assert found.views.close()
    assert found.workspace.close()


def test_the_view_is_sharp_at_rest_and_quick_when_it_moves(views: Views) -> None:
    assert views.picture().shape == (250, 360, 3)
    views.clock += 2 * RESTS_AFTER
    assert views.picture().shape == (500, 720, 3)
    drawn = views.drawn
    for _ in range(5):
        views.clock += RESTS_AFTER
        assert views.views.poll(FULL, DRAWN, 20.0) is None
    assert views.drawn == drawn, "once per rest"
    views.views.drag(30, 0, True, 500)
    assert views.picture().shape == (250, 360, 3)
