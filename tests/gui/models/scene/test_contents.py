"""Grid, axes, box, the view axes in the corner, and when a view rests."""

import numpy as np
import pytest

from gui.drawing.canvas import Canvas
from gui.models.scene.gizmo import along, draw_gizmo
from gui.models.scene.orbit import OrbitCamera
from gui.pages.stage_view import shown_at


def test_an_end_of_the_view_axes_is_where_its_axis_points_and_looks_along_it() -> None:
    orbit = OrbitCamera(target=np.array([1.0, 2.0, 3.0]), distance=4.0, yaw=0.5, pitch=0.3)
    view = orbit.camera(400, 300)
    ends = draw_gizmo(Canvas(400, 300), view, 14.0)
    middle = np.mean([corners.mean(axis=0) for _, corners in ends], axis=0)
    for name, corners in ends:
        direction = np.eye(3)["xyz".index(name[1])] * (1 if name[0] == "+" else -1)
        start, end = view.project(np.stack([orbit.target, orbit.target + 1e-3 * direction]))[0]
        seen, drawn = end - start, corners.mean(axis=0) - middle
        assert seen[0] * drawn[1] - seen[1] * drawn[0] == pytest.approx(0, abs=0.02)
        assert seen @ drawn > 0
        found = along(orbit, name)
        assert found.distance == pytest.approx(4.0)
        assert found.offset @ direction > 0.999
        assert (found.target == orbit.target).all()
    # the one in front is found where two lie over each other
    assert shown_at(ends, *ends[-1][1].mean(axis=0)) == ends[-1][0]
    assert shown_at(ends, 5, 250) == ""
