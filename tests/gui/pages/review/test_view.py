"""Edits in the window without a window: handles, lassos, picked points, trims, undo, and numbers in fields."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from gui.drawing.canvas import Canvas
from gui.models.playback.sources import TrainedSource, open_path
from gui.models.playback.stream_source import LeftOut, StreamSource
from gui.models.scene.compose import SplatLayer
from gui.models.scene.contents import Lines
from gui.models.scene.handles import crop_handles, default_crop, grabbed, moved_crop, picked
from gui.models.scene.orbit import OrbitCamera
from gui.models.take.workspace import Workspace
from gui.pages.review.frame import EditedFrame
from gui.pages.review.numbers import brush_field, brush_of, fields_of, with_numbers
from gui.pages.review.picture import draw_lines
from gui.pages.review.session import edits_of
from gui.pages.review.tools import FLOATERS, LEAST_BRUSH, MOST_BRUSH, hint
from gui.pages.review.view import EditView
from gui.pages.stage_view import OrbitView
from pipelines.takes.edits import change_edits, read_edits
from pipelines.takes.take import Take
from studio.camera_files import read_rig
from studio.edits import CropBox, EditList, Floaters, Ground, Trim, World
from studio.edits.selection import Paths
from studio.stream import CapturePlace
from tests.support.looping import heard
from tests.support.rigs import camera_at
from tests.support.waiting import wait_until

SIZE = (320, 240)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def view(take_copy: Path):
    workspace = Workspace()
    workspace.open(Take.open(take_copy))
    view = EditView(workspace)
    rig = read_rig(take_copy / "calibrate" / "rig.json")
    view.begin(OrbitCamera.looking_through(rig["cam0"], np.zeros(3), UP), UP, np.zeros((0, 3)))
    yield view
    view.close()
    workspace.close()


def drawn(view: EditView) -> np.ndarray:
    found: list[np.ndarray] = []

    def arrived() -> bool:
        done = view.settled  # before the poll: or a picture may be finished just after it
        picture = view.poll(SIZE)
        if picture is not None:
            found.append(picture)
        return bool(found) and done and picture is None

    wait_until("a picture", arrived)
    return found[-1]


def test_a_lasso_selects_and_removes_in_the_group_and_undo_brings_back(view: EditView) -> None:
    before = drawn(view)
    splats = view.counts["removed"], view.counts["selected"]
    assert splats == (0, 0)
    view.press("lasso")
    assert view.grabs(100, 60)
    for x, y in ((220, 60), (220, 120), (100, 120)):
        view.pull(x, y)
    view.release()
    selected_picture = drawn(view)
    selected = view.counts["selected"]
    assert selected > 20
    assert (selected_picture != before).any()
    assert edits_of(view.workspace) == EditList()  # nothing is removed yet
    view.press("remove here")
    drawn(view)
    assert (view.counts["removed"], view.counts["selected"], view.refused) == (selected, 0, "")
    (region,) = view.edits.regions
    assert region.frames == (0, 0)
    view.frame = 3  # of the other group
    drawn(view)
    assert view.counts["removed"] == 0
    view.frame = 0
    assert view.workspace.history.undo() == "Undone: lasso removal."
    assert edits_of(view.workspace) == EditList()
    assert view.workspace.history.redo() == "Redone: lasso removal."
    assert len(read_edits(view.workspace.context.take.edits).regions) == 1


def test_faces_of_the_box_are_dragged(view: EditView) -> None:
    drawn(view)
    view.press("crop")
    drawn(view)
    box = view.pending.crop
    assert view.counts["selected"] < 30  # the new box holds the performer
    camera = view.orbit.camera(*SIZE)
    top = next(one for one in crop_handles(box) if one.direction @ UP > 0.9)
    x, y = camera.project(top.place[None])[0][0]
    assert view.grabs(x + 3, y)
    view.pull(x + 3, y + 25)
    drawn(view)
    assert view.counts["selected"] > 10
    view.release()
    new = view.edits.crop
    assert new is not None
    moved = next(one for one in crop_handles(new) if one.direction @ UP > 0.9)
    assert camera.project(moved.place[None])[0][0] == pytest.approx([x, y + 25], abs=1.5)
    opposite = [next(one.place for one in crop_handles(each) if one.direction @ UP < -0.9) for each in (box, new)]
    assert np.allclose(*opposite)
    assert not view.grabs(1, 1)


def test_a_click_marks_a_detail_and_a_drag_sizes_it(view: EditView) -> None:
    before = drawn(view)
    view.press("detail")
    drawn(view)
    view.click(2, 2)
    assert view.refused == "There are no splats under the pointer. Click on the performer."
    camera = view.orbit.camera(*SIZE)
    x, y = camera.project(np.zeros((1, 3)))[0][0]
    view.refused = ""
    view.click(x, y)
    assert view.refused == ""
    (mark,) = view.edits.details
    assert [frame for frame, _ in mark.path] == [0, 2, 3, 4]
    assert camera.project(mark.at(0)[None])[0][0] == pytest.approx([x, y], abs=1), "behind the clicked pixel"
    assert (drawn(view) != before).any()
    assert view.counts["removed"] == 0
    top = view._handles(view.edits)[0]
    at = camera.project(top.place[None])[0][0]
    assert view.grabs(*at)
    view.pull(at[0], at[1] - 30)
    view.release()
    (larger,) = view.edits.details
    assert camera.project((larger.at(0) + larger.radius * UP)[None])[0][0] == pytest.approx(
        [at[0], at[1] - 30], abs=1.5
    )
    assert larger.path == mark.path
    changed = with_numbers(view.edits, "details", {"radius": f"{larger.radius:.4g}", "weight": "7"}, UP)
    assert changed.details[0] == larger.model_copy(update={"weight": 7.0}), "what was not changed is not rounded"
    assert "weight" in with_numbers(view.edits, "details", {"radius": "1", "weight": "0"}, UP)
    assert with_numbers(view.edits, "details", {"radius": "", "weight": ""}, UP) == EditList()
    assert "no detail yet" in with_numbers(EditList(), "details", {"radius": "1", "weight": "2"}, UP)
    assert view.workspace.history.undo() == "Undone: size of a detail."
    assert view.edits.details == (mark,)


def test_a_ground_plane_and_floaters_and_trims(view: EditView) -> None:
    drawn(view)
    view.press("floaters")
    drawn(view)
    assert view.pending.floaters is not None
    faint = float(np.quantile(view._edited.paths.opacities.max(axis=0), 0.1))
    view.pending = view.edits.with_(floaters=Floaters(opacity=faint))
    drawn(view)
    assert view.counts["selected"] > 0
    assert view.idle_buttons == {"remove here"}
    view.press("remove")
    assert view.edits.floaters is not None
    view.press("ground")
    drawn(view)
    handle = view._handles(view.pending)[0]
    x, y = view.orbit.camera(*SIZE).project(handle.place[None])[0][0]
    assert view.grabs(x, y)
    view.pull(x, y - 40)
    view.release()
    assert view.edits.ground.height > -0.5
    view.frame = 1
    view.press("in")
    assert view.edits.trim == Trim(first=1, last=4)
    view.frame = 3
    view.press("out")
    assert view.edits.trim == Trim(first=1, last=3)
    assert "trim to frames 1 to 3" in view.status
    view.frame = 4
    view.press("in")
    assert view.edits.trim == Trim(first=4, last=4)
    view.press("remove")
    assert "Nothing is selected" in view.refused


def test_a_drawing_that_selects_nothing_is_refused(view: EditView) -> None:
    drawn(view)
    assert view.idle_buttons == {"remove", "remove here"}
    view.press("lasso")
    for corner, selects in ((4, False), (120, True)):
        assert view.grabs(100, 2)
        for x, y in ((220, 2), (220, corner), (100, corner)):
            view.pull(x, y)
        view.release()
        drawn(view)
        assert (view.counts["selected"] > 0) is selects
        assert view.idle_buttons == (set() if selects else {"remove", "remove here"})
        view.press("remove")
        assert ("Nothing is selected" in view.refused) is not selects
        assert (view.edits == EditList()) is not selects


def ring(new: np.ndarray, old: np.ndarray) -> tuple[float, float, float]:
    """Middle and radius of what differs, pixels."""
    rows, columns = np.nonzero((new != old).any(axis=2))
    assert len(rows), "nothing differs"
    across, down = (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2
    return float(across), float(down), float(columns.max() - columns.min()) / 2


def test_the_brush_is_a_circle_at_the_pointer_and_selects_what_it_covers(view: EditView) -> None:
    view.press("brush")
    before = drawn(view)
    view.pointer = (0.25, 0.75)
    x, y, radius = ring(view.poll(SIZE), before)
    assert (x, y) == pytest.approx((80, 180), abs=1)
    assert radius == pytest.approx(view.brush * SIZE[1], abs=3), "and a line around it"
    assert view.poll(SIZE) is None, "as before"
    assert view.settled, "the splats are not drawn again for it"
    view.step_brush(4)
    x, y, larger = ring(view.poll(SIZE), before)
    assert larger == pytest.approx(1.25**4 * 0.03 * SIZE[1], abs=3)
    assert larger > radius + 3
    assert view.grabs(x, y)
    assert view._stroke.radius == pytest.approx(view.brush * SIZE[1])
    view.release()
    drawn(view)
    assert view.pending.regions[-1].radius == pytest.approx(view.brush * SIZE[1])
    view.pending = None
    drawn(view)
    view.pointer = None
    assert (view.poll(SIZE) == before).all(), "elsewhere there is none"
    view.pointer = (0.5, 0.5)
    assert view.poll(SIZE) is not None
    view.press("lasso")
    drawn(view)
    view.pointer = (0.2, 0.2)
    assert view.poll(SIZE) is None, "other tools have none"
    view.step_brush(100)
    assert view.brush == MOST_BRUSH
    view.step_brush(-100)
    assert view.brush == LEAST_BRUSH


def test_the_radius_of_the_brush_is_typed_in_percent() -> None:
    assert brush_field(0.03)[2] == "3"
    assert brush_of(" 4.5 ") == pytest.approx(0.045)
    assert brush_of("4.5%") == pytest.approx(0.045)
    for wrong in ("", "wide", "0", "-3", "nan", "60"):
        assert isinstance(brush_of(wrong), str), wrong


def limits(view: EditView, floaters: Floaters) -> None:
    """Type limits of floaters in Numbers."""
    view.press("floaters")
    view.pending = view.edits.with_(floaters=floaters)
    drawn(view)


def test_limits_are_lowered(view: EditView) -> None:
    drawn(view)
    least = view._edited.paths.opacities.max(axis=0)
    high, low = (float(np.quantile(least, share)) for share in (0.3, 0.1))
    limits(view, Floaters(opacity=high))
    view.press("remove")
    drawn(view)
    removed = view.counts["removed"]
    view.press("floaters")
    drawn(view)
    assert view.idle_buttons == {"remove", "remove here"}, "as they are"
    limits(view, Floaters(opacity=low))
    back = view.counts["back"]
    assert view.counts["selected"] == 0
    assert back == removed - (least < low).sum() > 0
    assert view.idle_buttons == {"remove here"}
    view.press("remove")
    drawn(view)
    assert (view.refused, view.edits.floaters) == ("", Floaters(opacity=low))
    assert view.counts["removed"] == removed - back


def test_limits_may_select_in_other_groups_only(view: EditView) -> None:
    drawn(view)
    limits(view, Floaters(splats=1))
    assert (view.counts["selected"], view.counts["back"]) == (0, 0)
    assert view.idle_buttons == {"remove here"}
    view.press("remove")
    assert (view.refused, view.edits.floaters) == ("", Floaters(splats=1))


def test_of_two_pictures_in_a_poll_the_newer_is_shown(view: EditView, monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = [np.full((2, 2, 3), number, np.uint8) for number in (1, 2)]
    for second, shown in ((pictures[1], 2), (None, 1)):
        polled, suggested = iter((pictures[0], second)), iter((False, True))
        monkeypatch.setattr(OrbitView, "poll", lambda self, size, polled=polled: next(polled))
        monkeypatch.setattr(view, "_suggest", lambda suggested=suggested: next(suggested))
        assert view.poll(SIZE)[0, 0, 0] == shown


def test_the_first_limits_that_select_something_are_proposed() -> None:
    frame = EditedFrame()
    frame.indices = range(1)
    means = np.linspace((0, 0, 0), (1, 1, 1), 2000, dtype=np.float32)[None]  # one cluster
    for faintest, opacity in ((0.01, 0.02), (0.03, 0.05), (0.08, 0.1), (0.5, 0.1)):
        opacities = np.full((1, 2000), 0.9, np.float32)
        opacities[0, :4] = faintest
        frame.paths = Paths(range(1), means, opacities)
        frame._selections = {}
        assert frame.proposed_floaters(EditList()).opacity == opacity
    none = hint("floaters", 0, 0, FLOATERS[-1], False)
    assert none.startswith("No splats selected in this group")
    assert "opacity below 0.1" in none
    assert "Raise the limits" in none
    assert hint("floaters", 1, 0, FLOATERS[0], False).startswith("1 splat selected: ")
    assert "Removed already" in hint("floaters", 0, 0, FLOATERS[0], True)
    assert hint("floaters", 0, 1200, FLOATERS[0], False).startswith("1,200 splats come back: opacity below 0.02")
    assert hint("floaters", 3, 1, None, False).startswith("3 splats selected, 1 splat comes back: no limits.")


def test_lines_behind_opaque_splats_are_faint() -> None:
    view = camera_at("a", (4.0, 0.0, 0.0))
    lines = Lines.of([[np.array([0.0, -1, 0]), np.array([0.0, 1, 0])]], (255, 255, 255), 2.0)
    shape = (view.height, view.width)
    row, middle = shape[0] // 2, shape[1] // 2

    def brightness(depth: float, alpha: float) -> int:
        canvas = Canvas(view.width, view.height, (0, 0, 0))
        splats = SplatLayer(np.zeros((*shape, 3), np.float32), np.full(shape, alpha), np.full(shape, depth))
        draw_lines(canvas, view, lines, splats)
        return int(canvas.pixels[row - 2 : row + 3, middle].max())

    in_front, behind = brightness(5.0, 1.0), brightness(3.0, 1.0)
    assert in_front > 200
    assert 20 < behind < 0.3 * in_front
    assert brightness(3.0, 0.1) == in_front, "transparent splats hide nothing"


def test_points_are_picked_for_the_world(view: EditView) -> None:
    drawn(view)
    camera = view.orbit.camera(*SIZE)
    view.press("origin")
    view.click(5, 5)
    assert "no splats" in view.refused
    view.refused = ""
    view.click(160, 120)
    origin = np.array(view.edits.world.origin)
    assert camera.project(origin[None])[0][0] == pytest.approx([160, 120], abs=1e-6)
    assert 0.3 < np.linalg.norm(origin) < 0.8  # on the ball's surface
    view.press("scale")
    points = heard(view.two_points)
    view.click(160, 160)
    view.click(160, 90)
    ((start, end),) = points
    assert not view.set_scale(start, end, 0)
    assert view.set_scale(start, end, 7.0)
    placed = view.edits.similarity.points(np.stack([start, end]))
    assert np.linalg.norm(placed[1] - placed[0]) == pytest.approx(7)
    view.press("up")
    view.click(160, 160)
    view.click(160, 90)
    up = np.array(view.edits.world.up)
    assert up @ UP > 0.7
    assert np.allclose(view.orbit.up, up)


def test_a_trimmed_and_placed_stream_is_shown_as_in_its_take(take_copy: Path, monkeypatch) -> None:
    take = Take.open(take_copy)
    plain = StreamSource(take.stream, in_take=True)
    world = World(up=(0, 0, 1), origin=(0.1, 0, 0), scale=50)
    # the same stream, read as one that begins with frame 2 of another world
    monkeypatch.setattr("gui.models.playback.stream_source.capture_place", lambda _: CapturePlace(2, world.similarity))
    placed = StreamSource(take.stream, in_take=True)
    try:
        assert (placed.frame_count, list(placed.group_starts)) == (7, [2, 5])
        with pytest.raises(LeftOut):
            placed.gaussians(1)
        there, here = placed.gaussians(3).means.double(), plain.gaussians(1).means.double()
        back = world.similarity.points(there.numpy())
        assert np.allclose(back, here.numpy(), atol=1e-3)
        assert placed.load_ms(3) is not None
    finally:
        plain.close()
        placed.close()


def test_trained_frames_are_shown_without_what_is_removed(take_copy: Path) -> None:
    take = Take.open(take_copy)
    whole = len(TrainedSource(take, 25.0).gaussians(4))
    change_edits(take.edits, EditList(ground=Ground(normal=(0, 0, 1), height=0)), "ground")
    opened = open_path(take_copy)
    left = opened.sources["trained"].gaussians(4)
    for source in opened.sources.values():
        source.close()
    assert 0 < len(left) < whole
    take.edits.write_text("{")
    opened = open_path(take_copy)
    assert "the edits are damaged" in opened.message
    for source in opened.sources.values():
        source.close()
    shutil.rmtree(take_copy)


def test_handles_and_points_under_the_pointer() -> None:
    view = camera_at("a", (4.0, 0.0, 0.0))
    box = CropBox(center=(0, 0, 0), size=(1, 1, 1))
    handles = crop_handles(box)
    near, far = (view.project(handles[number].place[None])[0][0] for number in (1, 0))
    assert np.allclose(near, far)  # one behind the other
    assert grabbed(handles, view, *near).name == "crop 0 1"
    assert grabbed(handles, view, near[0] + 40, near[1] + 40) is None
    thin = moved_crop(box, handles[3], -5)
    assert thin.size[1] == pytest.approx(0.01)
    points = np.random.default_rng(1).normal(size=(500, 3)) * (0.5, 0.3, 1)
    held = default_crop(points, EditList(), UP)
    assert held.holds(points).mean() > 0.98
    assert np.abs(held.axes @ UP).max() == pytest.approx(1)
    assert picked(view, np.zeros((0, 3)), 80, 60) is None


def test_numbers_in_fields_say_what_is_there_and_set_it() -> None:
    up = np.array([0.0, 0.0, 1.0])
    edits = EditList(world=World(up=(0, 0, 1), origin=(0, 0, 1), scale=2))
    for kind, texts in (
        ("crop", {"low": "-1 0 -1", "high": "1 3.5 1"}),
        ("ground", {"height": "0.25"}),
        ("floaters", {"opacity": "0.05", "share": "", "splats": "20", "distance": "0.1"}),
        ("trim", {"first": "2", "last": "7"}),
        ("world", {"up": "0 0 1", "origin": "0 1 0", "scale": "3"}),
    ):
        new = with_numbers(edits, kind, texts, up)
        assert isinstance(new, EditList)
        assert {key: text for key, _, text in fields_of(new, kind, up)} == texts
        assert with_numbers(new, kind, dict.fromkeys(texts, ""), up).model_dump()[kind] is None
    box = with_numbers(edits, "crop", {"low": "-1 0 -1", "high": "1 3.5 1"}, up).crop
    assert box.holds(np.array([[0, 0, 1.1], [0, 0, 2.7], [0, 0, 2.8]])).tolist() == [True, True, False]
    assert with_numbers(edits, "floaters", {"splats": "20"}, up).floaters == Floaters(splats=20)
    for kind, texts in (
        ("crop", {"low": "1 2", "high": "1 2 3"}),
        ("crop", {"low": "1 2 3", "high": "0 0 0"}),
        ("ground", {"height": "x"}),
        ("floaters", {"share": "2"}),
        ("trim", {"first": "5", "last": "2"}),
        ("world", {"up": "", "origin": "", "scale": "-1"}),
    ):
        words = with_numbers(edits, kind, texts, up)
        assert isinstance(words, str)
        assert words.endswith(".")


def test_what_a_box_cuts_off_is_not_called_selected() -> None:
    assert hint("crop", 1, 0, None, False).startswith("1 splat outside of the box")
    assert hint("ground", 1200, 0, None, False).startswith("1,200 splats below the plane")
    assert hint("crop", 0, 0, None, False) == hint("crop", None, 0, None, False)
    assert hint("lasso", 1, 0, None, False).startswith("1 splat selected")
