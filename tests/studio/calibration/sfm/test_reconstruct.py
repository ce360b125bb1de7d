"""Structure from motion on rendered images of a textured scene with known cameras."""

import contextlib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.errors import cancel_at, refuses
from tests.support.rigs import camera_at
from tests.support.settings import refuses_setting
from v3studio.studio.calibration import CalibrateSettings, align_rigs, calibrate_from_images, compare_rigs
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.calibration.sfm import job
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import Cancelled, StudioError

pytestmark = pytest.mark.long

Scene = tuple[dict[str, np.ndarray], Rig]
ONE_THREAD: dict[str, int] = {"threads": 1, "seed": 7}
SIZE, FOCAL = (240, 180), 220.0


@pytest.fixture(autouse=True)
def few_features(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fraction of the usual number, which is enough for small images."""
    monkeypatch.setattr(job, "MAX_FEATURES", 1000)


def texture(rng: np.random.Generator) -> np.ndarray:
    """A texture of blobs of many sizes, which gives many features."""
    total = np.zeros((512, 512, 3))
    for sigma in (2, 4, 8, 16):
        noise = cv2.GaussianBlur(rng.normal(size=(512, 512, 3)), (0, 0), sigma)
        total += noise / noise.std()
    return np.clip(128 + 38 * total, 0, 255).astype(np.uint8)


def room(rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Textured rectangles (corner, edge, edge, texture): a corner of a room with two upright boards."""
    planes = [
        ([-2, -2, 0], [4, 0, 0], [0, 4, 0]),
        ([-2, 2, 0], [4, 0, 0], [0, 0, 2.5]),
        ([-0.7, 0.3, 0], [0.9, 0.4, 0], [0, 0, 1.2]),
        ([0.2, -0.4, 0], [0.7, 0.5, 0], [0, 0, 0.8]),
    ]
    return [(*(np.array(part, float) for part in plane), texture(rng)) for plane in planes]


def render(camera: Camera, planes: list[Any]) -> np.ndarray:
    """Ray casting with four rays per pixel."""
    width, height = 2 * camera.width, 2 * camera.height
    columns, rows = np.meshgrid((np.arange(width) + 0.5) / 2, (np.arange(height) + 0.5) / 2)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(camera.K).T @ camera.rotation
    nearest = np.full(columns.shape, np.inf)
    image = np.zeros((*columns.shape, 3), np.uint8)
    for corner, u, v, picture in planes:
        normal = np.cross(u, v)
        distance = ((corner - camera.center) @ normal) / (rays @ normal)
        local = camera.center + rays * distance[..., None] - corner
        a, b = local @ u / (u @ u), local @ v / (v @ v)
        hit = (distance > 0) & (distance < nearest) & (a >= 0) & (a < 1) & (b >= 0) & (b < 1)
        nearest[hit] = distance[hit]
        grain = 128.0  # the same scale in meters on every plane
        x = ((a * np.linalg.norm(u) * grain) % 511).astype(np.float32)
        y = ((b * np.linalg.norm(v) * grain) % 511).astype(np.float32)
        image[hit] = cv2.remap(picture, x, y, cv2.INTER_LINEAR)[hit]
    return cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Images and true cameras of an arc of six cameras."""
    cameras = []
    for index in range(6):
        angle = np.radians(-125 + 14 * index)
        center = np.array([3.2 * np.cos(angle), 3.2 * np.sin(angle), 1.0 + 0.3 * (index % 2)])
        cameras.append(camera_at(f"view {index}", center, [0, 0.3, 0.6], focal=FOCAL, size=SIZE))
    rig = Rig(tuple(cameras))
    planes = room(np.random.default_rng(0))
    return {camera.name: render(camera, planes) for camera in rig}, rig


@pytest.fixture(scope="module")
def solved(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The solution with unknown intrinsics."""
    settings = CalibrateSettings(shared_intrinsics=True)
    return calibrate_from_images(scene[0], workdir=tmp_path_factory.mktemp("sfm"), settings=settings, **ONE_THREAD)


def test_cameras_are_found(scene: Scene, solved: Any) -> None:
    result = solved
    assert result.rig.names == tuple(scene[0])
    difference = compare_rigs(result.rig, scene[1])
    assert difference.center_percent < 1.0
    assert difference.rotation_degrees < 0.2
    for camera in result.rig:
        assert camera.fx == pytest.approx(FOCAL, rel=0.02)
        assert (camera.width, camera.height) == SIZE
    assert result.report.reprojection.mean < 0.5
    assert CalibrationReport.model_validate_json(result.report.model_dump_json(exclude_unset=True)) == result.report


def test_points_are_in_the_cameras_world(scene: Scene, solved: Any) -> None:
    """The sparse points are on the rendered planes."""
    points = align_rigs(solved.rig, scene[1]).points(solved.points)
    assert len(points) > 200
    off = np.full(len(points), np.inf)
    for corner, u, v, _ in room(np.random.default_rng(0)):
        normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        off = np.minimum(off, np.abs((points - corner) @ normal))
    assert np.quantile(off, 0.9) < 0.03


def test_same_seed_same_result_and_known_intrinsics(scene: Scene, tmp_path: Path) -> None:
    """Known intrinsics give a better result and do not change; it is bitwise reproducible."""
    truth = scene[1].subset(scene[1].names[:4])
    images = {name: scene[0][name] for name in truth.names}
    known = {camera.name: camera for camera in truth}
    first, second = (
        calibrate_from_images(images, workdir=tmp_path / run, known=known, **ONE_THREAD) for run in ("a", "b")
    )
    for camera in first.rig:
        np.testing.assert_array_equal(camera.world_to_camera, second.rig[camera.name].world_to_camera)
        np.testing.assert_array_equal(camera.K, truth[camera.name].K)
    assert compare_rigs(first.rig, truth).center_percent < 0.6


def test_several_sync_frames_and_an_older_solution(scene: Scene, tmp_path: Path) -> None:
    """Two noisy sync frames, read on demand; a camera that has moved since the earlier solution is reported."""
    truth = scene[1].subset(scene[1].names[:4])
    images = {name: scene[0][name] for name in truth.names}
    rng = np.random.default_rng(0)

    def sync_frame(name: str) -> np.ndarray:
        return np.clip(images[name] + rng.normal(0, 4, images[name].shape), 0, 255).astype(np.uint8)

    pushed = truth.names[2]
    before = []
    for camera in truth:
        pose = camera.world_to_camera.copy()
        pose[0, 3] += 0.02 * (camera.name == pushed)
        before.append(replace(camera, world_to_camera=pose))
    result = calibrate_from_images(
        {name: [partial(sync_frame, name), partial(sync_frame, name)] for name in images},
        workdir=tmp_path,
        poses=Rig(tuple(before)),
        **ONE_THREAD,
    )
    assert result.report.sync_frames == 2
    assert result.report.mapper == "known poses"
    assert compare_rigs(result.rig, truth).center_percent < 0.6
    moved = {name: motion.center for name, motion in result.report.moved.items()}
    assert max(moved, key=lambda name: moved[name]) == pushed
    assert moved[pushed] == pytest.approx(0.02, abs=0.008)
    for camera in result.rig:  # aligned with the earlier solution, and with its intrinsics
        assert np.linalg.norm(camera.center - truth[camera.name].center) < 0.02
        np.testing.assert_array_equal(camera.K, truth[camera.name].K)
    first, second = truth.names[:2]
    with refuses("calibration.image_count", value=1, camera="view 1", expected=2):
        calibrate_from_images({first: [images[first]] * 2, second: [images[second]]}, workdir=tmp_path)
    for setting, value in (("intrinsics_groups", [(first, "nobody")]), ("known_distance", (first, "nobody", 2))):
        with refuses("footage.unknown_camera", value="nobody", setting=f"calibrate.{setting}"):
            calibrate_from_images(images, workdir=tmp_path, settings=CalibrateSettings(**{setting: value}))
    for groups in (((first, second), (first, "view 2")), ((),)):
        with refuses_setting("intrinsics_groups"):
            CalibrateSettings(intrinsics_groups=groups)


def test_a_camera_without_a_pose(scene: Scene, tmp_path: Path) -> None:
    images = dict(list(scene[0].items())[:3])
    images["wall"] = np.full((*SIZE[::-1], 3), 90, np.uint8)
    with refuses("calibration.unregistered", value=["wall"]) as caught:
        calibrate_from_images(images, workdir=tmp_path / "a", **ONE_THREAD)
    assert caught.value.fields["unregistered"] == {"wall": "only 0 features in its image"}


def test_masks_and_names_with_any_letters(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the right half of each image may be used: there are no observations in the left half.

    COLMAP's C++ code interprets file names according to the locale of the worker process.
    """
    monkeypatch.setenv("LC_ALL", "C")
    monkeypatch.setattr(job, "MAX_FEATURES", 1500)
    images = {f"caméra 影 {name}": image for name, image in list(scene[0].items())[:4]}
    masks = {name: np.zeros(image.shape[:2], np.uint8) for name, image in images.items()}
    for mask in masks.values():
        mask[:, SIZE[0] // 2 :] = 255
    work = tmp_path / "prise é 影 1"
    with contextlib.suppress(StudioError):  # half of the images are too little for some cameras
        calibrate_from_images(images, masks, workdir=work, **ONE_THREAD)
    with np.load(work / "points.npz") as arrays:
        assert len(arrays["observations"]) > 100
        assert arrays["observations"][:, 2].min() > SIZE[0] / 2 - 2


def test_cancel_stops_colmap(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(Cancelled):
        calibrate_from_images(scene[0], workdir=tmp_path, **ONE_THREAD, progress=cancel_at(6))
    assert not (tmp_path / "solution.json").exists()


def test_hopeless_images(tmp_path: Path) -> None:
    flat = {name: np.full((60, 80, 3), 120, np.uint8) for name in ("a", "b", "c")}
    with refuses("calibration.no_solution", value=3):
        calibrate_from_images(flat, workdir=tmp_path, **ONE_THREAD)


def test_bad_input(scene: Scene, tmp_path: Path) -> None:
    images, truth = scene
    name = next(iter(images))
    with refuses("calibration.too_few_images", value=1, expected=2):
        calibrate_from_images({name: images[name]}, workdir=tmp_path)
    with refuses("calibration.mask_size", value=[5, 5], camera=name, expected=[*SIZE]):
        calibrate_from_images(images, {name: np.ones((5, 5), np.uint8)}, workdir=tmp_path)
    with refuses("calibration.mask_empty", camera=name):
        calibrate_from_images(images, {name: np.zeros(SIZE[::-1], np.uint8)}, workdir=tmp_path)
    with refuses("calibration.image_format", camera=name):
        calibrate_from_images({**images, name: images[name][..., 0]}, workdir=tmp_path)
    with refuses("calibration.intrinsics_size", value=[120, 90], camera=name, expected=[*SIZE]):
        calibrate_from_images(images, workdir=tmp_path, known={name: truth[name].scaled(0.5)})
    with refuses_setting("camera_model"):
        CalibrateSettings(camera_model="BENT")  # type: ignore[arg-type]
