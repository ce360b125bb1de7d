from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.looping import heard, wait_in_loop
from v3studio.gui.drawing.palette import BAD
from v3studio.gui.pages.choices import ViewMode
from v3studio.gui.pages.stage_views import StageViews
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.takes.take import Take
from v3studio.studio.yaml_text import parse_yaml

SIZE = (720, 500)
CORNERS = ((4.0, 3.0), (40.0, 3.0), (40.0, 30.0), (4.0, 30.0))
"""A rectangle over a part of the ball, in pixels of the 64x48 images."""


@pytest.fixture
def views(views: StageViews, take_copy: Path) -> StageViews:
    """Camera 1 of a take shown alone, to draw on."""
    views.workspace.open(Take.open(take_copy))
    wait_in_loop("the take", lambda: views.workspace.assessed)
    views.select("capture")
    views.choose(ViewMode.GARBAGE)
    views.show_alone("cam1")
    return views


def picture(views: StageViews) -> np.ndarray:
    """The image that Capture shows now."""
    capture = views.capture
    capture.em = 16
    return capture.draw(SIZE, capture.state())


def clicked(views: StageViews, points: tuple[tuple[float, float], ...], act: Callable[[float, float], None]) -> None:
    _, image = views.capture.image_at
    for point in points:
        act(*image.shown(point))


def masks(take: Path) -> dict[str, np.ndarray]:
    """The masks as a run reads them."""
    footage = Inputs(Take.open(take), load_config(take / "config.yaml")).raw_footage
    return {camera: footage.raw_mask(camera, 0) for camera in ("cam0", "cam1")}


def inside() -> np.ndarray:
    return cv2.fillPoly(np.zeros((48, 64), np.uint8), [np.array(CORNERS, np.int32)], 1) > 0


def draw(views: StageViews, corners: tuple[tuple[float, float], ...] = CORNERS) -> None:
    picture(views)
    clicked(views, (*corners, corners[0]), views.click)


def test_a_closed_polygon_is_taken_from_the_masks_of_its_camera(views: StageViews, take_copy: Path) -> None:
    before = masks(take_copy)
    assert (before["cam1"][inside()] > 127).any(), "it covers a part of the performer"
    picture(views)
    chosen = heard(views.camera_clicked)
    clicked(views, CORNERS, views.click)
    assert not (take_copy / "garbage.yaml").exists(), "not closed yet"
    assert not chosen, "a click draws, it does not show all cameras"
    clicked(views, CORNERS[:1], views.click)
    assert np.allclose(parse_yaml((take_copy / "garbage.yaml").read_text())["cam1"]["remove"][0], CORNERS, atol=0.2)
    after = masks(take_copy)
    core = cv2.erode(inside().astype(np.uint8), np.ones((3, 3))) > 0
    around = cv2.dilate(inside().astype(np.uint8), np.ones((3, 3))) > 0
    assert not after["cam1"][core].any()
    np.testing.assert_array_equal(after["cam1"][~around], before["cam1"][~around])
    np.testing.assert_array_equal(after["cam0"], before["cam0"])
    shown = picture(views)
    assert (shown == BAD).all(axis=2).sum() > 100, "its outline"
    # what was made with the old masks is out of date
    assert status(Take.open(take_copy), load_config(take_copy / "config.yaml"))["initialize"].state == "stale"


def test_undo_redo_and_delete(views: StageViews, take_copy: Path) -> None:
    settings, before = load_config(take_copy / "config.yaml"), masks(take_copy)
    draw(views)
    polygons, after = (take_copy / "garbage.yaml").read_bytes(), masks(take_copy)
    history = views.workspace.history
    assert history.undo() == "Undone: garbage mask of cam1."
    assert load_config(take_copy / "config.yaml").capture.garbage_masks is None
    assert not (take_copy / "garbage.yaml").exists()
    np.testing.assert_array_equal(masks(take_copy)["cam1"], before["cam1"])
    assert history.redo() == "Redone: garbage mask of cam1."
    assert (take_copy / "garbage.yaml").read_bytes() == polygons
    np.testing.assert_array_equal(masks(take_copy)["cam1"], after["cam1"])
    picture(views)
    clicked(views, ((60.0, 45.0),), views.context)  # outside
    assert (take_copy / "garbage.yaml").read_bytes() == polygons
    clicked(views, ((20.0, 15.0),), views.context)
    assert not (take_copy / "garbage.yaml").exists()
    np.testing.assert_array_equal(masks(take_copy)["cam1"], before["cam1"])
    assert history.undo() == "Undone: delete a garbage mask of cam1."
    assert (take_copy / "garbage.yaml").read_bytes() == polygons
    history.undo()
    assert load_config(take_copy / "config.yaml") == settings


def test_garbage_masks_that_are_images_are_not_drawn_over(views: StageViews, take_copy: Path) -> None:
    masks = take_copy.parent / "garbage"
    masks.mkdir()
    cv2.imwrite(str(masks / "cam1.png"), np.full((48, 64), 255, np.uint8))
    views.choose("masks")
    views.workspace.change_settings({"capture.garbage_masks": f"{masks}/{{camera}}.png"})
    picture(views)
    views.choose(ViewMode.GARBAGE)
    with refuses("gui.garbage_images", setting="capture.garbage_masks"):
        picture(views)
    assert views.capture.image_at is None, "no clicks draw"
