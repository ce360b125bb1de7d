"""Cameras, rigs, and intersections of rays."""

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.rigs import camera_at
from v3studio.studio.cameras import Camera, orbit

DISTORTIONS = {
    "pinhole": [],
    "radial": [-0.25, 0.08, 0.0, 0.0],
    "brown": [-0.2, 0.1, 0.001, 0.002, -0.03],
    "rational": [0.3, 0.05, 0.001, -0.001, 0.01, 0.5, 0.1, 0.02],
}


@pytest.mark.parametrize("kind", DISTORTIONS)
def test_unproject_inverts_project(kind: str) -> None:
    K = np.array([[150.0, 0, 84], [0, 160, 57], [0, 0, 1]])
    camera = camera_at("c", [2.0, -1.0, 0.7], [0.1, 0.2, 0.3], K=K, distortion=DISTORTIONS[kind])
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(camera.unproject(pixels, depth), points, atol=1e-8)
    rays = points - camera.center
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.ray_directions(pixels), directions, atol=1e-8)
    at_one = camera.center + rays / depth[:, None]
    np.testing.assert_allclose(camera.unproject(pixels), at_one, atol=1e-8)
    assert camera.project(points[:0])[0].shape == (0, 2)


def test_a_camera_looks_at_what_it_is_told_to() -> None:
    camera = Camera.look_at((1, 2, 3), (-2, 0, 1), (0, 0, 2), width=80, height=60, field_of_view=50, name="a")
    pixels, depth = camera.project(np.array([[-2.0, 0, 1], [-2.0, 0, 1.5]]))
    assert pixels[0] == pytest.approx([40, 30])
    assert depth[0] == pytest.approx(np.sqrt(17))
    assert pixels[1][0] == pytest.approx(40), "up is up in the image"
    assert pixels[1][1] < 30
    top = camera.ray_directions(np.array([[40.0, 0], [40.0, 60]]))
    assert np.degrees(np.arccos(top[0] @ top[1])) == pytest.approx(50)
    for target, up in (((1, 2, 3), (0, 0, 1)), ((1, 2, 9), (0, 0, 1)), ((0, 0, 0), (0, 0, 0))):
        with refuses("camera.no_direction", camera="a"):
            Camera.look_at((1, 2, 3), target, up, width=8, height=6, name="a")


def test_an_orbit_is_a_circle_around_its_target() -> None:
    target, up = np.array([1.0, -2.0, 0.5]), np.array([0.0, 0.6, 0.8])
    rig = orbit(target, 3.0, 8, width=64, height=64, up=5 * up, elevation=20)
    centers = np.array([camera.center for camera in rig])
    assert np.linalg.norm(centers - target, axis=1) == pytest.approx(np.full(8, 3.0))
    assert (centers - target) @ up == pytest.approx(np.full(8, 3 * np.sin(np.radians(20))))
    steps = np.linalg.norm(centers - np.roll(centers, 1, axis=0), axis=1)
    assert steps == pytest.approx(np.full(8, steps[0]))
    for camera in rig:
        assert camera.project(target[None])[0][0] == pytest.approx([32, 32])
