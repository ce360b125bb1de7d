"""Cameras for tests: single cameras that look at a point, and rings around it. Up is world z unless specified."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from v3studio.studio.cameras import Camera, Rig, look_at_pose

Z_UP = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)


def intrinsics(focal: float, size: tuple[int, int], offset: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """K (3, 3) with square pixels and a principal point `offset` pixels from the center of a (width, height) image."""
    return np.array([[focal, 0, size[0] / 2 + offset[0]], [0, focal, size[1] / 2 + offset[1]], [0, 0, 1.0]])


def pose(
    eye: Sequence[float] | np.ndarray, target: Sequence[float] | np.ndarray = ORIGIN, up: Sequence[float] = Z_UP
) -> np.ndarray:
    """World-to-camera matrix (4, 4) of a camera at `eye` that looks at `target`."""
    return look_at_pose(np.asarray(eye, float), np.asarray(target, float), np.asarray(up, float))


def camera_at(
    name: str,
    eye: Sequence[float] | np.ndarray,
    target: Sequence[float] | np.ndarray = ORIGIN,
    *,
    K: np.ndarray | None = None,
    focal: float = 200.0,
    size: tuple[int, int] = (160, 120),
    up: Sequence[float] = Z_UP,
    distortion: Sequence[float] | np.ndarray = (),
) -> Camera:
    """A camera at `eye` that looks at `target`; `focal` pixels and a centered principal point unless K is given."""
    K = intrinsics(focal, size) if K is None else K
    return Camera(name, *size, K, pose(eye, target, up), np.asarray(distortion, float))


def on_circle(angle: float, radius: float, height: float, target: Sequence[float] | np.ndarray = ORIGIN) -> np.ndarray:
    """(3,) the point at `angle` (in radians, from x toward y) on a horizontal circle `height` above `target`."""
    return np.asarray(target, float) + np.array([radius * np.cos(angle), radius * np.sin(angle), height])


def ring(
    count: int,
    *,
    radius: float = 3.0,
    heights: Sequence[float] = (0.0,),
    target: Sequence[float] | np.ndarray = ORIGIN,
    start: float = 0.0,
    name: str = "cam{}",
    **camera: Any,
) -> Rig:
    """`count` cameras evenly around `target`, all looking at it; camera i is called `name.format(i)`.

    `radius` is the horizontal distance, `heights` above the target are used in turn, `start` is the angle of the first
    camera in radians, `camera` is as in `camera_at`.
    """
    cameras = []
    for index in range(count):
        eye = on_circle(start + 2 * np.pi * index / count, radius, heights[index % len(heights)], target)
        cameras.append(camera_at(name.format(index), eye, target, **camera))
    return Rig(tuple(cameras))


def bent_rig(*distortions: Sequence[float]) -> Rig:
    """cam00, cam01, ... around the origin, with these distortions and an off-center principal point."""
    cameras = []
    for index, distortion in enumerate(distortions):
        K = np.array([[510.0 + index, 0, 331.25], [0, 505.5, 177.75 - index], [0, 0, 1]])
        eye = on_circle(0.4 + index * 1.3, 3.0, 0.4 * index)
        cameras.append(camera_at(f"cam{index:02d}", eye, K=K, size=(640, 360), distortion=distortion))
    return Rig(tuple(cameras))


BENT = bent_rig([], [-0.1, 0.05, 0.001, -0.002], [-0.2, 0.1, 0.001, 0.002, -0.03])
STRAIGHT = bent_rig([], [], [])
POINTS = np.random.default_rng(3).uniform(-0.5, 0.5, (50, 3))


def assert_same_images(found: Rig, wanted: Rig) -> None:
    """Assert that the cameras have the same names, and each projects every point to the same pixel and depth."""
    assert set(found.names) == set(wanted.names)
    for camera in wanted:
        twin = found[camera.name]
        assert (twin.width, twin.height) == (camera.width, camera.height)
        for values, expected in zip(twin.project(POINTS), camera.project(POINTS), strict=True):
            np.testing.assert_allclose(values, expected, atol=1e-6)
