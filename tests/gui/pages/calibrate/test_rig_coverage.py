"""How well a rig covers the performer, as the window draws and tells it."""

import numpy as np
import pytest

from gui.drawing.canvas import Canvas
from gui.drawing.palette import BAD, FAIR, GOOD, GROUND
from gui.models.scene.orbit import OrbitCamera
from gui.pages.calibrate.rig_coverage import FEW_CAMERAS, RigCoverage
from studio.cameras import Camera, Rig
from tests.support.rigs import camera_at

UP = np.array([0.0, 0.0, 1.0])


def camera(name: str, degrees: float) -> Camera:
    """2 m from the origin, level, looking at it."""
    turn = np.radians(degrees)
    return camera_at(name, (2 * np.cos(turn), 2 * np.sin(turn), 0.0))


def rig(*degrees: float) -> Rig:
    return Rig(tuple(camera(f"cam{at}", angle) for at, angle in enumerate(degrees)))


def rows(found: RigCoverage) -> dict[str, str]:
    return dict(found.block.rows)


def ball(count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    normals = np.random.default_rng(1).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return 0.3 * normals, normals


def test_few_cameras_are_warned_of_and_held_out_ones_do_not_count() -> None:
    cameras = rig(0, 40, 80, 180)
    found = RigCoverage.of(cameras, ("cam0", "cam1", "cam2"), np.zeros(3), ball())
    assert found is not None
    # good for 35 degrees each: 40 to 220 degrees are farther than 35 from cameras at 0, 40 and 80
    assert rows(found)["training cameras"] == "3"
    share = int(rows(found)["not covered"].split("%")[0])
    assert share == pytest.approx(100 * (360 - 80 - 70) / 360, abs=2)
    assert rows(found)["farthest view"] == "140 degrees away"
    assert found.block.note == FEW_CAMERAS
    # by hand, of points on a ball that the cameras see from far away: two or more cameras within 75 degrees
    normals = ball()[1]
    seen = [normals @ (each.center / 2) - 0.15 > np.cos(np.radians(75)) for each in cameras][:3]
    unseen = 100 * float((np.sum(seen, axis=0) < 2).mean())
    assert float(rows(found)["surface seen by 0 or 1"].split("%")[0]) == pytest.approx(unseen, abs=4)
    assert RigCoverage.of(cameras, (), np.zeros(3), None) is None


@pytest.mark.parametrize(("degrees", "color"), [(40, GOOD), (125, FAIR), (220, BAD)])
def test_directions_are_drawn_in_the_color_of_their_distance_from_a_camera(
    degrees: float, color: tuple[int, int, int]
) -> None:
    """Seen from a direction, the middle of the picture has its color, and it is the most frequent one around it."""
    cameras = rig(0, 40, 80)
    found = RigCoverage.of(cameras, cameras.names, np.zeros(3), None)
    eye = camera("", degrees).center * 3
    canvas = Canvas(400, 400, GROUND)
    found.draw(canvas, OrbitCamera.from_to(eye, np.zeros(3), UP, np.radians(30)).camera(400, 400), 2.0)
    middle = canvas.pixels[185:215, 185:215].reshape(-1, 3)
    count = {each: int((middle == each).all(axis=1).sum()) for each in (GOOD, FAIR, BAD)}
    assert count[color] > 0
    assert count[color] == max(count.values())
