"""The orbit camera, compared with projections of `studio.cameras.Camera`."""

import numpy as np
import pytest

from gui.models.scene.orbit import OrbitCamera
from studio.cameras import Camera

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


def test_looking_through_a_camera_gives_its_view() -> None:
    source = OrbitCamera(target=np.array([0.0, 0.0, 1.0]), distance=4.0, yaw=1.1, pitch=0.3, fov=0.6)
    camera = source.camera(800, 600)
    orbit = OrbitCamera.looking_through(camera, np.array([0.0, 0.0, 1.0]), UP)
    again = orbit.camera(800, 600)
    assert again.world_to_camera == pytest.approx(camera.world_to_camera, abs=1e-9)
    assert pytest.approx(camera.K) == again.K
    behind = Camera("back", 800, 600, camera.K, camera.world_to_camera)
    away = OrbitCamera.looking_through(behind, camera.center - 3.0 * camera.forward, UP)
    assert away.distance > 0
