from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tests.support.looping import heard
from tests.support.players import newest
from v3studio.gui.models.playback.sources import open_path
from v3studio.gui.models.playback.stream_source import StreamSource
from v3studio.gui.models.playback.viewpoint import Viewpoint
from v3studio.gui.models.scene.handles import crop_handles
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.review.numbers import fields_of, with_numbers
from v3studio.gui.pages.review.tools import LEAST_BRUSH, MOST_BRUSH
from v3studio.gui.pages.review.view import EditView
from v3studio.pipelines.takes.edits import read_edits
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits import EditList, Floaters, Trim, World
from v3studio.studio.playback import LeftOut
from v3studio.studio.stream import CapturePlace

SIZE = (320, 240)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def view(workspace: Workspace, take_copy: Path) -> EditView:
    workspace.open(Take.open(take_copy))
    viewpoint = Viewpoint()
    view = EditView(workspace, viewpoint)
    rig = read_rig(take_copy / "calibrate" / "rig.json")
    viewpoint.orbit = OrbitCamera.looking_through(rig["cam0"], np.zeros(3), UP)
    return view


def drawn(view: EditView) -> np.ndarray:
    return newest(lambda: view.poll(SIZE), lambda: view.settled)


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
    assert view.edits == EditList()  # nothing is removed yet
    asked = heard(view.range_wanted)
    view.press("remove")
    assert asked == [(range(3),)]
    view.remove_selected((0, 0))
    drawn(view)
    assert (view.counts["removed"], view.counts["selected"]) == (selected, 0)
    (region,) = view.edits.regions
    assert view.status == "Edits: 1 region removed"
    assert region.frames == (0, 0)
    view.frame = 3  # of the other group
    drawn(view)
    assert view.counts["removed"] == 0
    view.frame = 0
    assert view.workspace.history.undo() == "Undone: lasso removal."
    assert view.edits == EditList()
    assert view.workspace.history.redo() == "Redone: lasso removal."
    assert len(read_edits(view.workspace.context.take.edits).regions) == 1


def test_faces_of_the_box_are_dragged(view: EditView) -> None:
    drawn(view)
    view.press("crop")
    drawn(view)
    box = view.pending.crop
    assert view.counts["selected"] < 30  # the new box holds the performer
    camera = view.viewpoint.orbit.camera(*SIZE)
    top = next(one for one in crop_handles(box) if one.direction @ UP > 0.9)
    x, y = camera.project(top.place[None])[0][0]
    assert view.grabs(x + 3, y)
    view.pull(x + 3, y + 25)
    drawn(view)
    assert view.counts["selected"] > 10
    view.release()
    new = view.edits.crop
    moved = next(one for one in crop_handles(new) if one.direction @ UP > 0.9)
    assert camera.project(moved.place[None])[0][0] == pytest.approx([x, y + 25], abs=1.5)
    opposite = [next(one.place for one in crop_handles(each) if one.direction @ UP < -0.9) for each in (box, new)]
    assert np.allclose(*opposite)
    assert not view.grabs(1, 1)


def test_a_click_marks_a_detail_and_a_drag_sizes_it(view: EditView) -> None:
    before = drawn(view)
    view.press("detail")
    drawn(view)
    refused = heard(view.refusal)
    view.click(2, 2)
    assert "no splats" in refused.pop()[0]
    camera = view.viewpoint.orbit.camera(*SIZE)
    x, y = camera.project(np.zeros((1, 3)))[0][0]
    view.click(x, y)
    assert refused == []
    (mark,) = view.edits.details
    assert [frame for frame, _ in mark.path] == [0, 2, 3, 4]
    assert camera.project(mark.at(0)[None])[0][0] == pytest.approx([x, y], abs=1), "behind the clicked pixel"
    assert (drawn(view) != before).any()
    assert view.counts["removed"] == 0
    top = view.handles(view.edits)[0]
    at = camera.project(top.place[None])[0][0]
    assert view.grabs(*at)
    view.pull(at[0], at[1] - 30)
    view.release()
    (larger,) = view.edits.details
    edge = larger.at(0) + larger.radius * UP
    assert camera.project(edge[None])[0][0] == pytest.approx([at[0], at[1] - 30], abs=1.5)
    assert larger.path == mark.path
    changed = with_numbers(view.edits, "details", {"radius": f"{larger.radius:.4g}", "weight": "7"}, UP)
    assert changed.details[0] == larger.model_copy(update={"weight": 7.0}), "what was not changed is not rounded"
    assert "Weight" in with_numbers(view.edits, "details", {"radius": "1", "weight": "0"}, UP)
    assert with_numbers(view.edits, "details", {"radius": "", "weight": ""}, UP) == EditList()
    assert "no detail yet" in with_numbers(EditList(), "details", {"radius": "1", "weight": "2"}, UP)
    assert view.workspace.history.undo() == "Undone: size of a detail."
    assert view.edits.details == (mark,)


def test_a_ground_plane_and_floaters_and_trims(view: EditView) -> None:
    drawn(view)
    view.press("floaters")
    drawn(view)
    assert view.pending.floaters is not None
    trained = open_path(view.workspace.context.take.root).sources["trained"]
    group = [trained.gaussians(frame).opacities.numpy() for frame in range(3)]
    trained.close()
    faint = float(np.quantile(np.max(group, axis=0), 0.1))
    view.pending = view.edits.with_(floaters=Floaters(opacity=faint))
    drawn(view)
    assert view.counts["selected"] > 0
    assert view.idle_buttons == set()
    view.press("remove")
    assert view.edits.floaters is not None
    view.press("ground")
    drawn(view)
    handle = view.handles(view.pending)[0]
    x, y = view.viewpoint.orbit.camera(*SIZE).project(handle.place[None])[0][0]
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
    refused = heard(view.refusal)
    view.press("remove")
    assert "Nothing is selected" in str(refused)


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


def test_points_are_picked_for_the_world(view: EditView) -> None:
    drawn(view)
    camera = view.viewpoint.orbit.camera(*SIZE)
    view.press("origin")
    refused = heard(view.refusal)
    view.click(5, 5)
    assert "no splats" in str(refused)
    view.click(160, 120)
    origin = np.array(view.edits.world.origin)
    assert camera.project(origin[None])[0][0] == pytest.approx([160, 120], abs=1e-6)
    assert 0.3 < np.linalg.norm(origin) < 0.8  # on the ball's surface
    view.press("scale")
    points = heard(view.two_points)
    view.click(160, 160)
    view.click(160, 90)
    ((start, end),) = points
    assert view.set_scale(start, end, 0)
    assert not view.set_scale(start, end, 7.0)
    placed = view.edits.similarity.points(np.stack([start, end]))
    assert np.linalg.norm(placed[1] - placed[0]) == pytest.approx(7)
    view.press("up")
    view.click(160, 160)
    view.click(160, 90)
    up = np.array(view.edits.world.up)
    assert up @ UP > 0.7
    assert np.allclose(view.viewpoint.orbit.up, up)


def test_a_trimmed_and_placed_stream_is_shown_as_in_its_take(take_copy: Path, monkeypatch) -> None:
    take = Take.open(take_copy)
    plain = StreamSource(take.stream, in_take=True)
    world = World(up=(0, 0, 1), origin=(0.1, 0, 0), scale=50)
    # the same stream, read as one that begins with frame 2 of another world
    monkeypatch.setattr(
        "v3studio.gui.models.playback.stream_source.capture_place", lambda _: CapturePlace(2, world.similarity)
    )
    with closing(plain), closing(StreamSource(take.stream, in_take=True)) as placed:
        assert (placed.frame_count, list(placed.group_starts)) == (7, [2, 5])
        with pytest.raises(LeftOut):
            placed.gaussians(1)
        there, here = placed.gaussians(3).means.double(), plain.gaussians(1).means.double()
        back = world.similarity.points(there.numpy())
        assert np.allclose(back, here.numpy(), atol=1e-3)


def test_numbers_in_fields_say_what_is_there_and_set_it() -> None:
    up = np.array([0.0, 0.0, 1.0])
    edits = EditList(world=World(up=(0, 0, 1), origin=(0, 0, 1), scale=2))
    for kind, texts in (
        ("crop", {"low": "-1 0 -1", "high": "1 3.5 1"}),
        ("ground", {"height": "0.25"}),
        ("floaters", {"opacity": "0.05", "share": "", "splats": "20", "distance": "0.1"}),
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
        ("world", {"up": "", "origin": "", "scale": "-1"}),
    ):
        words = with_numbers(edits, kind, texts, up)
        assert isinstance(words, str)
        assert words.endswith(".")
