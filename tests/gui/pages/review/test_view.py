from pathlib import Path

import numpy as np
import pytest

from tests.support.looping import heard
from tests.support.players import newest
from v3studio.gui.models.playback.sources import open_path
from v3studio.gui.models.playback.viewpoint import Viewpoint
from v3studio.gui.models.scene.handles import crop_handles
from v3studio.gui.models.scene.orbit import OrbitCamera
from v3studio.gui.models.take.workspace import Workspace
from v3studio.gui.pages.review.editor import Editor
from v3studio.gui.pages.review.numbers import with_numbers
from v3studio.gui.pages.review.tools import LEAST_BRUSH, MOST_BRUSH
from v3studio.gui.pages.review.view import EditView
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig
from v3studio.studio.edits import EditList, Floaters

SIZE = (320, 240)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def view(workspace: Workspace, take_copy: Path) -> EditView:
    workspace.open(Take.open(take_copy))
    viewpoint = Viewpoint()
    view = EditView(Editor(workspace, viewpoint))
    rig = read_rig(take_copy / "calibrate" / "rig.json")
    viewpoint.orbit = OrbitCamera.looking_through(rig["cam0"], np.zeros(3), UP)
    return view


def drawn(view: EditView) -> np.ndarray:
    return newest(lambda: view.poll(SIZE), lambda: view.settled)


def test_a_lasso_selects_and_removes_in_the_group_and_undo_brings_back(view: EditView) -> None:
    before = drawn(view)
    splats = view.editor.measured.removed, view.editor.measured.selected
    assert splats == (0, 0)
    view.editor.press("lasso")
    assert view.grabs(100, 60)
    for x, y in ((220, 60), (220, 120), (100, 120)):
        view.pull(x, y)
    view.release()
    selected_picture = drawn(view)
    selected = view.editor.measured.selected
    assert selected > 20
    assert (selected_picture != before).any()
    assert view.editor.edits == EditList()  # nothing is removed yet
    asked = heard(view.editor.range_wanted)
    view.editor.press("remove")
    assert asked == [(range(3),)]
    view.editor.remove_selected((0, 0))
    drawn(view)
    assert (view.editor.measured.removed, view.editor.measured.selected) == (selected, 0)
    (region,) = view.editor.edits.regions
    assert view.editor.status == "Edits: 1 region removed"
    assert region.frames == (0, 0)
    view.frame = 3  # of the other group
    drawn(view)
    assert view.editor.measured.removed == 0
    view.frame = 0
    assert view.editor.workspace.history.undo() == "Undone: lasso removal."
    assert view.editor.edits == EditList()
    assert view.editor.workspace.history.redo() == "Redone: lasso removal."
    assert len(read_edits(view.editor.workspace.context.take.edits).regions) == 1


def test_faces_of_the_box_are_dragged(view: EditView) -> None:
    drawn(view)
    view.editor.press("crop")
    drawn(view)
    box = view.editor.pending.crop
    assert view.editor.measured.selected < 30  # the new box holds the performer
    camera = view.viewpoint.orbit.camera(*SIZE)
    top = next(handle for handle in crop_handles(box) if handle.direction @ UP > 0.9)
    x, y = camera.project(top.place[None])[0][0]
    assert view.grabs(x + 3, y)
    view.pull(x + 3, y + 25)
    drawn(view)
    assert view.editor.measured.selected > 10
    view.release()
    new = view.editor.edits.crop
    moved = next(handle for handle in crop_handles(new) if handle.direction @ UP > 0.9)
    assert camera.project(moved.place[None])[0][0] == pytest.approx([x, y + 25], abs=1.5)
    below = (next(handle for handle in crop_handles(each) if handle.direction @ UP < -0.9) for each in (box, new))
    assert np.allclose(*(handle.place for handle in below)), "the opposite face stays"
    assert not view.grabs(1, 1)


def test_a_click_marks_a_detail_and_a_drag_sizes_it(view: EditView) -> None:
    before = drawn(view)
    view.editor.press("detail")
    drawn(view)
    refused = heard(view.editor.refusal)
    view.click(2, 2)
    assert "no splats" in refused.pop()[0]
    camera = view.viewpoint.orbit.camera(*SIZE)
    x, y = camera.project(np.zeros((1, 3)))[0][0]
    view.click(x, y)
    assert refused == []
    (mark,) = view.editor.edits.details
    assert [frame for frame, _ in mark.path] == [0, 2, 3, 4]
    assert camera.project(mark.at(0)[None])[0][0] == pytest.approx([x, y], abs=1), "behind the clicked pixel"
    assert (drawn(view) != before).any()
    assert view.editor.measured.removed == 0
    top = view.handles(view.editor.edits)[0]
    at = camera.project(top.place[None])[0][0]
    assert view.grabs(*at)
    view.pull(at[0], at[1] - 30)
    view.release()
    (larger,) = view.editor.edits.details
    edge = larger.at(0) + larger.radius * UP
    assert camera.project(edge[None])[0][0] == pytest.approx([at[0], at[1] - 30], abs=1.5)
    assert larger.path == mark.path
    changed = with_numbers(view.editor.edits, "details", {"radius": f"{larger.radius:.4g}", "weight": "7"}, UP)
    assert changed.details[0] == larger.model_copy(update={"weight": 7.0}), "what was not changed is not rounded"
    assert "Weight" in with_numbers(view.editor.edits, "details", {"radius": "1", "weight": "0"}, UP)
    assert with_numbers(view.editor.edits, "details", {"radius": "", "weight": ""}, UP) == EditList()
    assert "no detail yet" in with_numbers(EditList(), "details", {"radius": "1", "weight": "2"}, UP)
    assert view.editor.workspace.history.undo() == "Undone: size of a detail."
    assert view.editor.edits.details == (mark,)


def test_floaters_and_a_ground_plane_are_set(view: EditView) -> None:
    drawn(view)
    view.editor.press("floaters")
    drawn(view)
    assert view.editor.pending.floaters is not None
    trained = open_path(view.editor.workspace.context.take.root).sources["trained"]
    group = [trained.gaussians(frame).opacities.numpy() for frame in range(3)]
    trained.close()
    faint = float(np.quantile(np.max(group, axis=0), 0.1))
    view.editor.pending = view.editor.edits.with_(floaters=Floaters(opacity=faint))
    drawn(view)
    assert view.editor.measured.selected > 0
    assert view.editor.idle_buttons == set()
    view.editor.press("remove")
    assert view.editor.edits.floaters is not None
    view.editor.press("ground")
    drawn(view)
    handle = view.handles(view.editor.pending)[0]
    x, y = view.viewpoint.orbit.camera(*SIZE).project(handle.place[None])[0][0]
    assert view.grabs(x, y)
    view.pull(x, y - 40)
    view.release()
    assert view.editor.edits.ground.height > -0.5


def ring(new: np.ndarray, old: np.ndarray) -> tuple[float, float, float]:
    """The middle and the radius of the pixels that differ."""
    rows, columns = np.nonzero((new != old).any(axis=2))
    assert len(rows), "nothing differs"
    across, down = (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2
    return float(across), float(down), float(columns.max() - columns.min()) / 2


def test_the_brush_is_a_circle_at_the_pointer_and_selects_what_it_covers(view: EditView) -> None:
    view.editor.press("brush")
    before = drawn(view)
    view.editor.pointer = (0.25, 0.75)
    x, y, radius = ring(view.poll(SIZE), before)
    assert (x, y) == pytest.approx((80, 180), abs=1)
    assert radius == pytest.approx(view.editor.brush * SIZE[1], abs=3), "and a line around it"
    assert view.poll(SIZE) is None, "as before"
    assert view.settled, "the splats are not drawn again for it"
    view.editor.step_brush(4)
    x, y, larger = ring(view.poll(SIZE), before)
    assert larger == pytest.approx(1.25**4 * 0.03 * SIZE[1], abs=3)
    assert larger > radius + 3
    assert view.grabs(x, y)
    view.release()
    drawn(view)
    assert view.editor.pending.regions[-1].radius == pytest.approx(view.editor.brush * SIZE[1])
    view.editor.pending = None
    drawn(view)
    view.editor.pointer = None
    assert (view.poll(SIZE) == before).all(), "elsewhere there is none"
    view.editor.pointer = (0.5, 0.5)
    assert view.poll(SIZE) is not None
    view.editor.press("lasso")
    drawn(view)
    view.editor.pointer = (0.2, 0.2)
    assert view.poll(SIZE) is None, "other tools have none"
    view.editor.step_brush(100)
    assert view.editor.brush == MOST_BRUSH
    view.editor.step_brush(-100)
    assert view.editor.brush == LEAST_BRUSH


def test_points_are_picked_for_the_world(view: EditView) -> None:
    drawn(view)
    camera = view.viewpoint.orbit.camera(*SIZE)
    view.editor.press("origin")
    refused = heard(view.editor.refusal)
    view.click(5, 5)
    assert "no splats" in str(refused)
    view.click(160, 120)
    origin = np.array(view.editor.edits.world.origin)
    assert camera.project(origin[None])[0][0] == pytest.approx([160, 120], abs=1e-6)
    assert 0.3 < np.linalg.norm(origin) < 0.8  # on the ball's surface
    view.editor.press("scale")
    points = heard(view.editor.two_points)
    view.click(160, 160)
    view.click(160, 90)
    ((start, end),) = points
    assert view.editor.set_scale(start, end, 0)
    assert not view.editor.set_scale(start, end, 7.0)
    placed = view.editor.edits.similarity.points(np.stack([start, end]))
    assert np.linalg.norm(placed[1] - placed[0]) == pytest.approx(7)
    view.editor.press("up")
    view.click(160, 160)
    view.click(160, 90)
    up = np.array(view.editor.edits.world.up)
    assert up @ UP > 0.7
    assert np.allclose(view.viewpoint.orbit.up, up)
