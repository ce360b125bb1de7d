"""Cameras in USD files: `UsdGeomCamera` prims, also below transforms, with time samples; one camera per time code."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from v3studio.studio.cameras import OPENGL_AXES, Camera
from v3studio.studio.errors import StudioError
from v3studio.studio.formats.usd import opened_stage, usd

_MOST_FRAMES = 100_000
_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # to y up


def read_cameras(path: Path, width: int, height: int) -> dict[str, dict[int, Camera]]:
    """Cameras of a file, y up and meters, by name and time code; one that stands still has one camera."""
    pxr = usd()
    stage = opened_stage(pxr, path)
    cameras = {}
    for prim in stage.Traverse():
        if prim.IsA(pxr.UsdGeom.Camera):
            name = prim.GetName() if prim.GetName() not in cameras else str(prim.GetPath())
            cameras[name] = {time: _camera(pxr, stage, path, prim, time, width) for time in _times(pxr, path, prim)}
    if not cameras:
        raise StudioError("usd.no_camera", "there is no camera", file=path, fix="Export it with its camera.")
    return cameras


def _times(pxr: Any, path: Path, prim: Any) -> list[int]:
    """The whole time codes over which the camera, or a transform above it, changes."""
    samples: set[float] = set()
    for attribute in prim.GetAttributes():
        samples |= set(attribute.GetTimeSamples())
    while not prim.IsPseudoRoot():
        samples |= set(pxr.UsdGeom.Xformable(prim).GetTimeSamples())
        prim = prim.GetParent()
    if not samples:
        return [0]
    first, last = math.floor(min(samples)), math.ceil(max(samples))
    if last - first > _MOST_FRAMES:
        problem = f"a camera has time codes from {first} to {last}; {_MOST_FRAMES:,} are supported"
        raise StudioError("usd.unsupported", problem, file=path, value=[first, last])
    return list(range(first, last + 1))


def _camera(pxr: Any, stage: Any, path: Path, prim: Any, time: float, width: int) -> Camera:
    lens = pxr.UsdGeom.Camera(prim).GetCamera(time)
    matrix = np.array(lens.transform).T
    linear = matrix[:3, :3]
    size = abs(np.linalg.det(linear)) ** (1 / 3)
    straight = size > 0 and np.allclose(linear @ linear.T, size**2 * np.eye(3), atol=1e-4 * size**2)
    problem = "" if straight and np.linalg.det(linear) > 0 else "its transform stretches, shears or mirrors"
    if lens.projection != pxr.Gf.Camera.Perspective:
        problem = "it is orthographic"
    if not (lens.focalLength > 0 and lens.horizontalAperture > 0 and lens.verticalAperture > 0):
        problem = "its focal length or an aperture is not above 0"
    if problem:
        raise StudioError("usd.unsupported", f"{prim.GetPath()}: {problem}", file=path, value=time)
    meters = pxr.UsdGeom.GetStageMetersPerUnit(stage)
    upright = np.eye(3) if pxr.UsdGeom.GetStageUpAxis(stage) == pxr.UsdGeom.Tokens.y else _Z_UP
    pose = np.eye(4)
    pose[:3, :3] = upright @ linear / size
    pose[:3, 3] = upright @ matrix[:3, 3] * meters
    height = max(1, round(width * lens.verticalAperture / lens.horizontalAperture))
    right = 0.5 - lens.horizontalApertureOffset / lens.horizontalAperture
    down = 0.5 + lens.verticalApertureOffset / lens.verticalAperture
    K = np.array(
        [
            [width * lens.focalLength / lens.horizontalAperture, 0, width * right],
            [0, height * lens.focalLength / lens.verticalAperture, height * down],
            [0, 0, 1],
        ]
    )
    return Camera(prim.GetName(), width, height, K, np.linalg.inv(pose @ OPENGL_AXES))
