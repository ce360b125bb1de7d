"""Garbage masks drawn in Capture: clicks in, polygons, masks and settings out."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from gui.drawing.palette import BAD
from gui.models.playback.player import PlayerPresenter
from gui.models.take.workspace import Workspace
from gui.pages.capture.view import GARBAGE
from gui.pages.stage_views import StageViews
from gui.widgets.raycast import RaycastMesh
from pipelines.config import load_config
from pipelines.runs.runner import status
from pipelines.stages.footage import TakeFootage
from pipelines.takes.take import Take
from studio.yaml_text import parse_yaml
from tests.support.looping import heard, wait_in_loop

SIZE = (720, 500)
CORNERS = ((4.0, 3.0), (40.0, 3.0), (40.0, 30.0), (4.0, 30.0))
"""A rectangle over a part of the ball, in pixels of the 64x48 images."""


@pytest.fixture
def views(workspace: Workspace, take_copy: Path) -> Iterator[StageViews]:
    """Camera 1 of a take shown alone, to draw on."""
    found = StageViews(workspace, PlayerPresenter(), RaycastMesh)
    workspace.open(Take.open(take_copy))
    wait_in_loop("the take", lambda: workspace.assessed)
    found.select("capture")
    found.choose(GARBAGE)
    found.show_alone("cam1")
    yield found
    assert found.close()


def picture(views: StageViews) -> np.ndarray:
    """What Capture shows now."""
    capture = views.capture
    capture.em = 16
    return capture.draw(SIZE, capture.state())


def clicked(views: StageViews, points: tuple[tuple[float, float], ...], act: Callable[[float, float], None]) -> None:
    image = views.capture.image_at
    left, top, width, _ = image.place
    for x, y in points:
        act(left + x * width / 64, top + y * width / 64)


def masks(take: Path) -> dict[str, np.ndarray]:
    """As a run reads them."""
    footage = TakeFootage(Take.open(take), load_config(take / "config.yaml")).raw
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


def test_clicks_are_pixels_of_the_image_that_is_shown(views: StageViews, finished_project: Path) -> None:
    shown = picture(views)
    image = views.capture.image_at
    left, top, width, height = (round(value) for value in image.place)
    filmed = cv2.imread(str(finished_project / "capture" / "images" / "cam1" / "000.png"))[..., ::-1]
    large = cv2.resize(filmed, (width, height), interpolation=cv2.INTER_LINEAR)
    found = cv2.matchTemplate(shown, np.ascontiguousarray(large[2:-2, 2:-2]), cv2.TM_SQDIFF)
    _, _, place, _ = cv2.minMaxLoc(found)
    # within half a pixel of the image; the masks' outline is over it
    np.testing.assert_allclose(place, (left + 2, top + 2), atol=0.5 * width / 64)


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


def test_corners_are_taken_back_and_escape_forgets_them(views: StageViews, take_copy: Path) -> None:
    picture(views)
    clicked(views, CORNERS[:3], views.click)
    clicked(views, ((50.0, 40.0),), views.context)
    assert np.allclose(views.capture.garbage.corners, CORNERS[:2], atol=0.2)
    assert views.leave_camera()
    assert views.capture.garbage.corners == ()
    assert views.capture.camera == "cam1", "the next Escape shows all cameras"
    assert views.leave_camera()
    assert views.capture.camera == ""
    picture(views)
    chosen = heard(views.camera_clicked)
    views.click(*dict(views.capture.places)["cam1"].mean(axis=0))
    assert chosen == [("cam1",)], "with all cameras shown, a click chooses one"


def test_polygons_of_a_file_are_kept_and_the_file_is_not_changed(views: StageViews, take_copy: Path) -> None:
    """Drawn on an image of half the size, as the file says."""
    given = take_copy.parent / "mine.yaml"
    given.write_text("cam1: {keep: [[[0, 0], [32, 0], [32, 24], [0, 24]]], size: [32, 24]}  # mine")
    text = given.read_text()
    assert views.workspace.change_setting("capture.garbage_masks", str(given)) is None
    draw(views)
    assert given.read_text() == text
    found = parse_yaml((take_copy / "garbage.yaml").read_text())["cam1"]
    assert found["keep"] == [[[0, 0], [32, 0], [32, 24], [0, 24]]]
    assert found["size"] == [32, 24]
    assert np.allclose(np.array(found["remove"][0]) * 2, CORNERS, atol=0.2)
    views.workspace.history.undo()
    assert load_config(take_copy / "config.yaml").capture.garbage_masks == str(given)
    assert not (take_copy / "garbage.yaml").exists()


def test_garbage_masks_that_are_images_are_not_drawn_over(views: StageViews, take_copy: Path) -> None:
    masks = take_copy.parent / "garbage"
    masks.mkdir()
    cv2.imwrite(str(masks / "cam1.png"), np.full((48, 64), 255, np.uint8))
    assert views.workspace.change_setting("capture.garbage_masks", f"{masks}/{{camera}}.png") is None
    refused = heard(views.capture.garbage.refused)
    draw(views)
    assert all("images" in str(why) and "capture.garbage_masks" in str(why) for (why,) in refused)
    assert not (take_copy / "garbage.yaml").exists()
    assert refused
    refused.clear()
    picture(views)
    assert not refused, "not again with each frame"
    others = Path(shutil.copytree(masks, take_copy.parent / "others"))
    assert views.workspace.change_setting("capture.garbage_masks", f"{others}/{{camera}}.png") is None
    picture(views)
    assert "images" in str(refused.pop()), "other images"
    views.choose("masks")
    picture(views)
    views.choose(GARBAGE)
    picture(views)
    assert "images" in str(refused.pop()), "the mode was chosen again"


def test_they_stay_with_a_take_that_is_moved_or_copied(views: StageViews, take_copy: Path, tmp_path: Path) -> None:
    draw(views)
    capture = load_config(take_copy / "config.yaml").capture.root
    around = [Path(tempfile.mkdtemp(prefix=f"{letter}-", dir=capture.parent)) for letter in "az"]
    assert str(around[0]) < str(capture) < str(around[1]), "in both places of the alphabet"
    drawn, before = masks(take_copy)["cam1"], digest(take_copy)
    copied = Path(shutil.copytree(take_copy, tmp_path / "copied"))
    moved = Path(shutil.copytree(take_copy, tmp_path / "other place" / "moved"))
    elsewhere = [Path(shutil.copytree(take_copy, folder / "moved")) for folder in around]
    for name in ("garbage.yaml", "config.yaml"):  # the views' take is still open
        (take_copy / name).unlink()
    np.testing.assert_array_equal(masks(moved)["cam1"], drawn)
    assert [digest(take) for take in (moved, *elsewhere)] == [before] * 3, "what was made with them stays valid"
    for folder in around:
        shutil.rmtree(folder)
    (copied / "garbage.yaml").write_text("cam1: {remove: [[[0, 0], [64, 0], [64, 48], [0, 48]]]}")
    assert not masks(copied)["cam1"].any(), "a copy has its own"
    np.testing.assert_array_equal(masks(moved)["cam1"], drawn)
    assert digest(copied) != before


def digest(take: Path) -> str:
    return TakeFootage(Take.open(take), load_config(take / "config.yaml")).digest
