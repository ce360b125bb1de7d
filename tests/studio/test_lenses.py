"""Fisheye lenses against OpenCV's and COLMAP's, and the pinhole views of them."""

import cv2
import numpy as np
import pytest

from tests.support.rigs import intrinsics, pose
from v3studio.studio.cameras import Camera
from v3studio.studio.footage.warp import Warp

SIZE = (640, 360)
BOW, PRISM = [0.03, -0.008, 0.001, 0.002], [0.03, -0.008, 0.001, 0.002, 0.004, -0.003, 0.002, 0.001]
RAYS = np.random.default_rng(1).uniform(-2, 2, (300, 2))


def fisheye(*coefficients: float, focal: float = 275.0) -> Camera:
    K = intrinsics(focal, SIZE, (3.0, -2.0))
    return Camera("wide", *SIZE, K, pose((0, -3, 0.5)), np.array(coefficients), fisheye=True)


def test_projects_as_opencv_and_colmap_do() -> None:
    pycolmap = pytest.importorskip("pycolmap")
    local = np.column_stack([RAYS, np.ones(len(RAYS))])
    camera = fisheye(*BOW)
    expected, _ = cv2.fisheye.projectPoints(local[:, None], np.zeros(3), np.zeros(3), camera.K, np.array(BOW))
    world = camera.unproject(expected.reshape(-1, 2))
    np.testing.assert_allclose(world @ camera.rotation.T + camera.translation, local, atol=1e-9)
    camera = fisheye(*PRISM)
    K, (k1, k2, k3, k4, p1, p2, s1, s2) = camera.K, PRISM
    params = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], k1, k2, p1, p2, k3, k4, s1, s2]
    theirs = pycolmap.Camera(model="THIN_PRISM_FISHEYE", width=SIZE[0], height=SIZE[1], params=params)
    pixels, _ = camera.project((local - camera.translation) @ camera.rotation)
    np.testing.assert_allclose(pixels, np.array(theirs.img_from_cam(local)), atol=1e-9)
    np.testing.assert_allclose(camera.normalized(pixels), RAYS, atol=1e-9)


def test_directions_behind_the_image_plane_are_not_known() -> None:
    camera = fisheye(*[0.0] * 4, focal=100.0)  # the image's corners are at 210 degrees
    assert np.isnan(camera.normalized(np.array([[0.0, 0.0]]))).all()
    assert np.isfinite(camera.normalized(np.array([[320.0, 180.0], [200.0, 180.0]]))).all()


@pytest.mark.parametrize("focal", [275.0, 100.0])
def test_the_view_of_a_fisheye_resolves_as_much_as_its_middle(focal: float) -> None:
    """A pattern drawn on a plane looks the same through the lens and its view as through that view alone."""
    camera = fisheye(*BOW, focal=focal)
    warp = Warp(camera, *SIZE, 1.0)
    view = warp.camera
    assert view.is_pinhole
    assert view.fx == camera.fx
    reach = np.degrees(np.arctan([view.cx / view.fx, (view.width - view.cx) / view.fx]))
    np.testing.assert_allclose(reach, 60, atol=0.3)

    def shown(seen: Camera) -> np.ndarray:
        rows, columns = np.mgrid[: seen.height, : seen.width] + 0.5
        rays = seen.normalized(np.column_stack([columns.ravel(), rows.ravel()])).reshape(seen.height, seen.width, 2)
        pattern = 127 + 60 * np.sin(9 * rays[..., 0]) + 60 * np.cos(11 * rays[..., 1])
        return np.nan_to_num(np.where(np.abs(rays).max(-1) < 3, pattern, 0)).astype(np.uint8)

    drawn = warp.apply(shown(camera), warp.maps(), smooth=True)
    assert drawn.shape == (view.height, view.width)
    off = np.abs(drawn.astype(int) - shown(view))[4:-4, 4:-4]
    assert np.quantile(off, 0.99) <= 4


def test_a_mask_beyond_the_view_is_measured() -> None:
    warp = Warp(fisheye(*BOW, focal=200.0), *SIZE, 1.0)
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    mask[100:200, 300:340] = 255
    assert warp.beyond(mask) == 0
    mask[:, :] = 0
    mask[100:200, :20] = 255
    assert warp.beyond(mask) == 1
