import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.players import newest
from tests.support.tiny_capture import HEIGHT
from v3studio.gui.drawing.palette import ACCENT, FAIR
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.calibrate.marks import TieMarks, expected
from v3studio.gui.pages.calibrate.points_view import PointsView
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration import TiePoint, read_tie_points
from v3studio.studio.camera_files import read_rig

SIZE = (900, 600)


@pytest.fixture
def stage_view(workspace: Workspace, take_copy: Path) -> PointsView:
    workspace.open(Take.open(take_copy))
    return PointsView(workspace)


def picture(stage_view: PointsView) -> np.ndarray:
    """The view's picture, once it shows what was requested."""
    return newest(lambda: stage_view.poll(SIZE), lambda: stage_view.settled)


def is_close(pixel: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool(np.abs(pixel.astype(int) - color).max() < 60)


def test_a_click_marks_where_the_picture_is_clicked(stage_view: PointsView) -> None:
    before = picture(stage_view)
    stage_view.snaps = False
    magnifier = stage_view.magnifiers[stage_view.camera]
    stage_view.click(*magnifier.shown((30.0, 20.0)))
    (point,) = read_tie_points(stage_view.path)
    assert point.pixels[stage_view.camera] == pytest.approx((30.0, 20.0), abs=0.02)
    assert point.frame == 0
    x, y = map(round, magnifier.shown((30.0, 20.0)))
    assert not is_close(before[y, x + 6], ACCENT)
    after = picture(stage_view)
    for dx, dy in ((6, 0), (-6, 0), (0, 6), (0, -6)):  # the arms of the cross; its center is open
        assert is_close(after[y + dy, x + dx], ACCENT)
    assert not is_close(after[y, x], ACCENT)
    stage_view.click(*magnifier.shown((40.0, 25.0)))  # the same point, moved
    (point,) = read_tie_points(stage_view.path)
    assert point.pixels[stage_view.camera] == pytest.approx((40.0, 25.0), abs=0.02)
    first = stage_view.camera
    stage_view.step_camera(1)
    picture(stage_view)
    stage_view.click(*stage_view.magnifiers[stage_view.camera].shown((10.0, 12.0)))
    assert stage_view.camera != first
    assert set(read_tie_points(stage_view.path)[0].pixels) == {first, stage_view.camera}
    stage_view.unmark()
    assert set(read_tie_points(stage_view.path)[0].pixels) == {first}
    stage_view.edit(TieMarks.remove)
    assert read_tie_points(stage_view.path) == ()


def test_where_the_other_cameras_expect_it(stage_view: PointsView, take_copy: Path) -> None:
    """The finished take's cameras are known, so a point's position in one follows from its marks in others."""
    rig = read_rig(Take.open(take_copy).rig)
    place = np.array([[0.05, -0.03, 0.1]]) + rig.focus
    pixels = {camera.name: tuple(camera.project(place)[0][0].tolist()) for camera in rig}
    names = rig.names
    two = TiePoint("both", {name: pixels[name] for name in names[:2]})
    pixel = expected(two, rig[names[2]], rig)
    assert pixel == pytest.approx(np.array([pixels[names[2]]]), abs=1e-3)
    single = TiePoint("one", {names[0]: pixels[names[0]]})
    line = expected(single, rig[names[2]], rig)
    ways = np.linalg.norm(line - np.array(pixels[names[2]]), axis=1)
    assert ways.min() < 0.05 * rig[names[2]].width  # the line passes through the true position
    assert expected(single, rig[names[0]], rig) is None
    picture(stage_view)
    for name in names[:2]:
        stage_view.marks.mark(name, *pixels[name], 0)
    stage_view.show_camera(names[2])
    shown = picture(stage_view)
    x, y = stage_view.magnifiers[names[2]].shown(pixels[names[2]])
    radius = 0.7 * stage_view.em
    for dx, dy in ((radius, 0), (-radius, 0), (0, radius), (0, -radius)):  # a ring at the expected position
        assert is_close(shown[round(y + dy), round(x + dx)], FAIR)


def test_a_file_that_changes_or_breaks_meanwhile(stage_view: PointsView) -> None:
    picture(stage_view)
    stage_view.marks.mark(stage_view.camera, 3, 4, 0)
    text = stage_view.path.read_text()
    stage_view.path.write_text(text.replace("point 1", "a name from an editor"))
    picture(stage_view)
    assert [point.name for point in stage_view.marks.points] == ["a name from an editor"]
    stage_view.path.write_text("points: [")
    picture(stage_view)
    assert "points.yaml: invalid YAML (line 1" in stage_view.status
    stage_view.click(500, 300)
    assert stage_view.path.read_text() == "points: ["  # it is not overwritten
    stage_view.path.write_text(text)
    picture(stage_view)
    assert [point.name for point in stage_view.marks.points] == ["point 1"]
    assert "invalid YAML" not in stage_view.status


def test_another_take_with_its_cameras(stage_view: PointsView, take_copy: Path, finished: Path, tmp_path: Path) -> None:
    before = picture(stage_view)
    camera = stage_view.camera
    capture = Path(shutil.copytree(finished / "capture", tmp_path / "capture"))
    for file in capture.rglob("*.png"):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        image[..., :3] = 255 - image[..., :3]
        cv2.imwrite(str(file), np.pad(image, ((0, 20), (0, 0), (0, 0))))
    rig = capture / "cameras.json"
    rig.write_text(rig.read_text().replace(f'"height": {HEIGHT}', f'"height": {HEIGHT + 20}'))
    other = Path(shutil.copytree(take_copy, tmp_path / "other"))
    text = (other / "config.yaml").read_text()
    (other / "config.yaml").write_text(re.sub(r"(?m)^  root:.*", f"  root: {capture}", text))
    stage_view.workspace.open(Take.open(other))
    after = picture(stage_view)
    assert stage_view.camera == camera
    assert (after != before).any()
    raw = stage_view.workspace.context.raw_footage
    magnifier = stage_view.magnifiers[camera]
    assert (magnifier.width, magnifier.height) == raw.raw_size(camera)
    x, y = map(round, magnifier.shown((10.0, 10.0)))
    assert np.abs(after[y, x] - raw.raw_image(camera, 0)[10, 10].astype(int)).max() < 30


def test_footage_that_is_gone(workspace: Workspace, take_copy: Path, tmp_path: Path) -> None:
    settings = take_copy / "config.yaml"
    lines = settings.read_text().splitlines()
    settings.write_text("\n".join(f"  root: {tmp_path}/gone" if line.startswith("  root:") else line for line in lines))
    workspace.open(Take.open(take_copy))
    stage_view = PointsView(workspace)
    picture(stage_view)
    assert stage_view.names() == ()
    assert stage_view.status == ""
    stage_view.edit(TieMarks.add)
    stage_view.step_camera(1)
    stage_view.unmark()
    stage_view.edit(TieMarks.undo)
    stage_view.click(450, 300)
    stage_view.wheel(0, 0, 1)
    assert not (take_copy / "points.yaml").exists()
