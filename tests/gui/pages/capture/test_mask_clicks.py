from pathlib import Path

import pytest

from tests.support.looping import wait_in_loop
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_views import StageViews
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.take import Take


def test_clicks_on_a_camera_correct_its_mask_and_are_taken_back(views: StageViews, take_copy: Path) -> None:
    views.workspace.open(Take.open(take_copy))
    wait_in_loop("the take", lambda: views.workspace.assessed)
    views.select("capture")
    views.choose(ViewMode.CORRECT)
    views.show_alone("cam1")

    def press(pixel: tuple[float, float], performer: bool) -> None:
        capture = views.capture
        capture.em = 16
        capture.draw((720, 500), capture.state())
        _, image = capture.image_at or pytest.fail("no camera is shown alone")
        (place,) = image.shown([pixel])
        (views.click if performer else views.context)(*place)

    press((2.0, 2.0), performer=True)
    press((40.0, 24.0), performer=False)
    clicks = read_edits(take_copy / "edits.json").masks
    assert [(click.camera, click.frame, click.performer) for click in clicks] == [("cam1", 0, True), ("cam1", 0, False)]
    assert clicks[1].at == pytest.approx((40.0, 24.0), abs=0.2)
    press((2.0, 2.0), performer=True)  # on its dot
    assert read_edits(take_copy / "edits.json").masks == clicks[1:]
    views.workspace.history.undo()
    views.workspace.history.undo()
    assert read_edits(take_copy / "edits.json").masks == clicks[:1]
