import cv2
import numpy as np
import pytest

from v3studio.studio.cameras import Camera
from v3studio.studio.scenery.depths import depth_maps, looked_at, unprojected

SIZE = (128, 96)
WALL, SIDE, PIXELS = 4.0, 6.0, 512  # depth of a square wall, its width, pixels of its picture


def before_wall() -> tuple[list[Camera], dict[str, np.ndarray]]:
    """Five cameras before a wall with noise, except for a band without texture."""
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.uniform(0, 255, (PIXELS, PIXELS, 3)).astype(np.float32), (0, 0), 3)
    picture = np.clip((picture - 128) * 6 + 128, 0, 255)
    picture[:, 230:270] = 120
    corners = np.array([[0, 0], [PIXELS, 0], [PIXELS, PIXELS], [0, PIXELS]], np.float32)
    places = (corners / PIXELS - 0.5) * SIDE
    cameras, plates = [], {}
    for number, x in enumerate((-1.0, -0.5, 0.0, 0.5, 1.0)):
        eye = (x, 0.3 * (number % 2), 0.0)
        camera = Camera.look_at(eye, (0, 0, 3), (0, -1, 0), width=SIZE[0], height=SIZE[1], name=f"cam{number}")
        seen = camera.project(np.column_stack([places, np.full(4, WALL)]))[0].astype(np.float32)
        warp = cv2.getPerspectiveTransform(corners, seen)
        plates[camera.name] = cv2.warpPerspective(picture, warp, SIZE).astype(np.uint8)
        cameras.append(camera)
    return cameras, plates


def test_depths_of_a_wall_are_found_also_where_it_has_no_texture() -> None:
    cameras, plates = before_wall()
    assert looked_at(cameras) == pytest.approx([0, 0, 3], abs=0.05)
    for each in depth_maps(plates, cameras):
        z = unprojected(each.camera, each.depth)[..., 2]
        inner = np.s_[8:-8, 8:-8]
        assert np.median(np.abs(z[inner] - WALL)) < 0.15
        assert (np.abs(z[inner] - WALL) < 0.4).mean() > 0.9
        assert each.sure[inner].mean() > 0.8
        assert np.abs(z[each.sure] - WALL).mean() < 0.25


def test_points_are_where_their_pixels_are() -> None:
    camera = before_wall()[0][1]
    depth = np.linspace(1, 2, SIZE[0] * SIZE[1]).reshape(SIZE[1], SIZE[0])
    pixels, z = camera.project(unprojected(camera, depth).reshape(-1, 3))
    assert z == pytest.approx(depth.reshape(-1))
    rows, columns = np.indices(depth.shape)
    assert pixels == pytest.approx(np.stack([columns + 0.5, rows + 0.5], -1).reshape(-1, 2))
