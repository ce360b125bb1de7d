"""Camera paths are exact at keys and smooth in between; movies contain the rasterizer's pictures."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch

from tests.studio.formats.conftest import MakeVideo
from tests.support.errors import refuses
from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Camera, Rig, look_at_pose
from v3studio.studio.formats.camera_path import (
    CameraPath,
    Key,
    read_path_keys,
    subject_sphere,
    turntable,
    write_path_keys,
)
from v3studio.studio.formats.movie import render_movie
from v3studio.studio.rasterizer import rasterize

K = np.array([[100.0, 0, 60], [0, 100, 40], [0, 0, 1]])
UP = np.array([0.0, 0, 1])


def camera(angle: float, focal: float = 100.0, width: int = 120, height: int = 80) -> Camera:
    eye = np.array([2.5 * math.cos(angle), 2.5 * math.sin(angle), 0.6])
    intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return Camera(f"at {angle:.2f}", width, height, intrinsics, look_at_pose(eye, np.zeros(3), UP))


KEYS = [Key(0.5, camera(0.0)), Key(1.5, camera(0.8, 120)), Key(2.0, camera(1.0, 150)), Key(4.0, camera(2.6, 90))]


def test_at_a_keys_time_it_is_the_keys_camera() -> None:
    path = CameraPath(KEYS, 120, 80)
    assert path.duration == 3.5
    for key in KEYS:
        found = path.camera(key.time - 0.5)
        np.testing.assert_allclose(found.world_to_camera, key.camera.world_to_camera, atol=1e-9)
        np.testing.assert_allclose(found.K, key.camera.K, atol=1e-9)
    for outside, key in ((-1.0, KEYS[0]), (9.0, KEYS[-1])):
        np.testing.assert_allclose(path.camera(outside).world_to_camera, key.camera.world_to_camera, atol=1e-9)


def test_speed_never_jumps_and_focal_lengths_stay_between_the_keys() -> None:
    path = CameraPath(KEYS, 120, 80)
    step = 0.004
    cameras = [path.camera(time) for time in np.arange(0, 3.5, step)]
    speed = np.diff([camera.center for camera in cameras], axis=0) / step
    turning = np.diff([camera.rotation for camera in cameras], axis=0) / step
    assert np.linalg.norm(speed, axis=1).max() > 1
    assert np.abs(np.diff(speed, axis=0)).max() < 0.06  # a kink at a key would be a step of a tenth or more
    assert np.abs(np.diff(turning, axis=0)).max() < 0.06
    assert all(90 - 1e-9 <= camera.fx <= 150 + 1e-9 for camera in cameras)


def test_another_size_of_the_same_shape() -> None:
    camera = CameraPath(KEYS, 240, 160).camera(0)
    assert (camera.width, camera.height) == (240, 160)
    np.testing.assert_allclose(camera.K, np.diag([2, 2, 1]) @ KEYS[0].camera.K)
    with refuses("camera_path.aspect_ratio", camera=KEYS[0].camera.name, expected=(100, 100)):
        CameraPath(KEYS, 100, 100)


def test_paths_files(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    keys = [replace(key, frame=index * 2.0) for index, key in enumerate(KEYS)]
    write_path_keys(keys, path)
    found = read_path_keys(path, 9.0)
    assert [(key.time, key.frame) for key in found] == [(0.5, 0), (1.5, 2), (2.0, 4), (4.0, 6)]
    np.testing.assert_array_equal(found[1].camera.world_to_camera, KEYS[1].camera.world_to_camera)
    assert CameraPath(found, 120, 80).frame(1.5) == pytest.approx(4)
    assert CameraPath(found, 120, 80).frame(100) == pytest.approx(6)

    write_rig(Rig(tuple(key.camera for key in KEYS)), tmp_path / "rig.json")
    assert [key.time for key in read_path_keys(tmp_path / "rig.json", 9.0)] == [0, 3, 6, 9]


@pytest.mark.parametrize(
    ("edit", "code", "fields"),
    [
        (lambda v: v.update(version=2), "camera_path.unsupported_version", {"value": 2, "expected": 1}),
        (lambda v: v.update(keys=[]), "camera_path.invalid_key", {"name": "keys"}),
        (lambda v: v["keys"][1].pop("time"), "camera_path.invalid_key", {"name": "keys.1.time"}),
        (lambda v: v["keys"][1].update(frame=float("nan")), "camera_path.invalid_key", {"name": "keys.1.frame"}),
        (lambda v: v["keys"][1].pop("camera"), "camera_path.invalid_key", {"name": "keys.1.camera"}),
        (lambda v: v["keys"][1].update(time="soon"), "camera_path.invalid_key", {"name": "keys.1.time"}),
        (lambda v: v["keys"][1].update(time=0.1), "camera_path.times", {"file": None}),
        (lambda v: v["keys"][1].update(frame=3), "camera_path.frames", {"file": None}),
    ],
)
def test_damaged_paths(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], code: str, fields: dict[str, Any]
) -> None:
    path = tmp_path / "path.json"
    write_path_keys(KEYS, path)
    values = json.loads(path.read_text())
    edit(values)
    path.write_text(json.dumps(values))
    with refuses(code, **{"file": path, **fields}):
        CameraPath(read_path_keys(path, 1.0), 120, 80)


def test_the_turntable_sees_all_of_the_subject_from_everywhere(make_video: MakeVideo) -> None:
    video = replace(make_video((4,)), view=camera(0.7))
    center, radius = subject_sphere(video)
    circling = turntable(video, 160, 90, elevation=15)
    start = circling(0.0)
    toward = start.center - center
    assert math.degrees(math.asin(toward[2] / np.linalg.norm(toward))) == pytest.approx(15)
    assert math.atan2(toward[1], toward[0]) == pytest.approx(0.7, abs=0.05)  # begins on the view's side
    np.testing.assert_allclose(circling(1.0).center, start.center, atol=1e-9)
    quarter = circling(0.25).center - center
    assert toward[:2] @ quarter[:2] == pytest.approx(0, abs=1e-9)
    points = np.concatenate([frame.means.numpy() for frame in video])
    inside = points[np.linalg.norm(points - center, axis=1) <= radius]
    assert len(inside) > 0.9 * len(points)
    for share in np.linspace(0, 1, 8):
        found = circling(share)
        assert -found.rotation[1] @ UP > 0.9
        np.testing.assert_allclose(found.forward, (center - found.center) / np.linalg.norm(center - found.center))
        pixels, depth = found.project(inside)
        assert ((pixels >= 0) & (pixels <= [160, 90]) & (depth > 0)[:, None]).all()
    with refuses("export.invalid_elevation", value=90):
        turntable(video, 160, 90, elevation=90)


def pictures(path):
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        return stream.average_rate, [frame.to_ndarray(format="rgb24") for frame in file.decode(stream)]


def test_a_movie_shows_what_the_rasterizer_draws(tmp_path: Path, make_video: MakeVideo) -> None:
    video = replace(make_video((4,)), background=(0.2, 0.6, 0.4))
    path = CameraPath([Key(0, camera(0.0)), Key(0.5, camera(0.6))], 120, 80)
    count = render_movie(video, tmp_path / "a.mp4", path.camera, lambda time: time * video.fps, 0.5, 16, crf=4)
    rate, images = pictures(tmp_path / "a.mp4")
    assert (count, len(images), rate) == (8, 8, 16)
    for index in (0, 3, 7):
        time = index / 16
        splats = video.read(int(time * 20) % 4)
        meant = rasterize(splats, path.camera(time), torch.tensor(video.background)).image.clamp(0, 1).numpy()
        difference = np.abs(images[index] / 255 - meant)
        assert difference.mean() < 0.008  # color is stored at half resolution
        assert difference[:10, :10].mean() < 0.01
    wrong = rasterize(video.read(2), path.camera(0), torch.tensor(video.background)).image.clamp(0, 1).numpy()
    assert np.abs(images[7] / 255 - wrong).mean() > 2 * difference.mean()  # the comparison is sensitive to the camera


def test_colors_are_those_of_bt709(tmp_path: Path, make_video: MakeVideo) -> None:
    """The background's luma by BT.709's own formula; by BT.601's it would be 116."""
    red, green, blue = 0.2, 0.6, 0.4
    video = replace(make_video((1,)), background=(red, green, blue))
    path = CameraPath([Key(0, camera(0.0))], 120, 80)
    render_movie(video, tmp_path / "a.mp4", path.camera, lambda time: 0.0, 0.1, 20, crf=4)
    with av.open(str(tmp_path / "a.mp4")) as file:
        context = file.streams.video[0].codec_context
        assert (context.colorspace, context.color_range) == (1, 1)
        luma = next(file.decode(video=0)).to_ndarray()[:80]
    assert luma[:8, :8].mean() == pytest.approx(16 + 219 * (0.2126 * red + 0.7152 * green + 0.0722 * blue), abs=1)


def test_movies_that_cannot_be(tmp_path: Path, make_video: MakeVideo) -> None:
    video = make_video((2,))
    still = CameraPath([Key(0, camera(0.0))], 120, 80).camera
    odd = CameraPath([Key(0, camera(0.0, width=121))], 121, 80).camera

    def make(name="a.mp4", camera=still, seconds=0.2, fps=10.0, **more):
        render_movie(video, tmp_path / name, camera, lambda time: 0.0, seconds, fps, **more)

    for arguments, code, fields in (
        ({"name": "a.avi"}, "export.unsupported_format", {"value": ".avi"}),
        ({"camera": odd}, "export.invalid_size", {}),
        ({"fps": 0.0}, "export.invalid_setting", {"name": "fps", "value": 0.0}),
        ({"seconds": float("inf")}, "export.invalid_setting", {"name": "seconds", "value": float("inf")}),
        ({"crf": 60}, "export.invalid_setting", {"name": "crf", "value": 60}),
    ):
        with refuses(code, **fields):
            make(**arguments)
    assert list(tmp_path.iterdir()) == []
