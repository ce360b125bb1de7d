"""The render studio's lenses and camera files, against OpenCV and the library's own readers; Blender is not needed."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

import v3studio as v3

STUDIO = Path(__file__).parents[2] / "benchmarks" / "studio"


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(STUDIO))
    import rig

    yield rig
    del sys.modules["rig"]


def test_the_distorted_lens_is_that_of_opencv(rig: ModuleType) -> None:
    lens = rig.Lens("brown", 0.7, (-0.21, 0.06, 0.001, -0.0015, 0.0))
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (200, 2))
    rays = np.c_[points, np.ones(200)]
    distorted, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), np.array(lens.distortion))
    np.testing.assert_allclose(lens.undistorted(distorted[:, 0]), points, atol=1e-9)


def test_the_fisheye_lens_is_that_of_opencv(rig: ModuleType) -> None:
    lens = rig.Lens("fisheye", 0.46, (0.03, -0.008, 0.001, 0.0))
    angles = np.linspace(0.01, 1.5, 50)
    rays = np.c_[np.sin(angles), np.zeros(50), np.cos(angles)][None]
    points, _ = cv2.fisheye.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), np.array(lens.distortion))
    np.testing.assert_allclose(lens.radius(angles), points[0, :, 0], atol=1e-9)


@pytest.mark.parametrize("name", ["cameras.json", "transforms.json"])
def test_every_camera_file_describes_the_same_cameras(rig: ModuleType, tmp_path: Path, name: str) -> None:
    lens = rig.Lens("brown", 0.7, (-0.1, 0.02, 0.001, -0.0015, 0.0))
    cameras = rig.ring(5, 2.75, (1.0, 2.0), lens=lens)
    rig.write_rig_files(tmp_path, cameras, 25.0, 3)
    storage = cv2.FileStorage(str(tmp_path / "intri.yml"), cv2.FILE_STORAGE_READ)
    for camera, ours in zip(v3.read_rig(tmp_path / name).cameras, cameras, strict=True):
        np.testing.assert_allclose(camera.K, ours.matrix)
        np.testing.assert_allclose(camera.world_to_camera[:3], ours.world_to_camera, atol=1e-9)
        np.testing.assert_allclose(np.resize(camera.distortion, 4), lens.distortion[:4])
        # OpenCV's file counts pixels from the center of the first one.
        np.testing.assert_allclose(storage.getNode(f"K_{ours.name}").mat()[:2, 2], camera.K[:2, 2] - 0.5)
