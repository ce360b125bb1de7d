"""The orbit camera, compared with projections of `studio.cameras.Camera`."""

import numpy as np
import pytest

from v3studio.gui.models.scene.orbit import OrbitCamera

UP = np.array([0.0, 0.0, 1.0])


def project(orbit: OrbitCamera, point: np.ndarray, width: int = 640, height: int = 360) -> np.ndarray:
    pixels, depth = orbit.camera(width, height).project(point[None])
    assert depth[0] > 0
    return pixels[0]


def test_a_view_is_filled_by_what_it_must_show() -> None:
    points = np.random.default_rng(3).uniform((-0.3, -0.2, 0.4), (0.5, 0.2, 1.9), (4000, 3))
    orbit = OrbitCamera(target=np.array([0.0, 0.0, 2.0]), distance=4.0, yaw=0.4, pitch=0.1)
    for width, height in ((45, 56), (80, 30)):
        pixels, depth = orbit.filling(points, width, height).project(points)
        assert (depth > 0).all()
        size, low, high = np.array([width, height]), *np.quantile(pixels, (0.01, 0.99), axis=0)
        assert (low > 0).all()
        assert (high < size).all()
        assert 0.8 < ((high - low) / size).max() < 0.95
        assert (low + high) / 2 == pytest.approx(size / 2, abs=0.04 * max(width, height))


def test_the_scene_follows_the_pointer() -> None:
    orbit = OrbitCamera(distance=3.0, yaw=0.7, pitch=0.2)
    near_side = orbit.target + 0.3 * orbit.offset
    start = project(orbit, near_side)
    moved = project(orbit.orbit(40.0, 25.0), near_side)
    assert moved[0] > start[0] + 1
    assert moved[1] > start[1] + 1
    panned = project(orbit.pan(33.0, -12.0, 360), orbit.target)
    assert panned == pytest.approx([320.0 + 33.0, 180.0 - 12.0], abs=1e-6)


def test_around_holds_the_points_whatever_strays() -> None:
    generator = np.random.default_rng(3)
    points = generator.normal(size=(2000, 3)) * [0.3, 0.2, 0.8] + [1.0, 2.0, 3.0]
    points[:5] = 1e4
    orbit = OrbitCamera.around(points, UP)
    assert orbit.target == pytest.approx([1.0, 2.0, 3.0], abs=0.2)
    pixels, depth = orbit.camera(640, 360).project(points[5:])
    inside = (depth > 0) & (pixels >= 0).all(1) & (pixels < [640, 360]).all(1)
    assert inside.mean() > 0.95
    assert OrbitCamera.around(np.zeros((0, 3)), UP).distance > 0


def test_looking_through_a_camera_gives_its_view() -> None:
    source = OrbitCamera(target=np.array([0.0, 0.0, 1.0]), distance=4.0, yaw=1.1, pitch=0.3, fov=0.6)
    camera = source.camera(800, 600)
    orbit = OrbitCamera.looking_through(camera, np.array([0.0, 0.0, 1.0]), UP)
    again = orbit.camera(800, 600)
    assert again.world_to_camera == pytest.approx(camera.world_to_camera, abs=1e-9)
    assert pytest.approx(camera.K) == again.K
    away = OrbitCamera.looking_through(camera, camera.center - 3.0 * camera.forward, UP)
    assert away.distance > 0
