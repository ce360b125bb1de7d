"""Calibration targets: rendered images with known corners, and synthetic rigs."""

import re
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest

from tests.support.errors import cancel_at, refuses
from tests.support.rigs import pose
from tests.support.settings import refuses_setting
from v3studio.studio.calibration import (
    CalibrateSettings,
    CalibrationTarget,
    TargetObservation,
    calibrate_from_target,
    calibrate_intrinsics,
    compare_rigs,
    detect_target,
    write_target_pdf,
)
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.calibration.target.intrinsics import MOST_VIEWS, most_different
from v3studio.studio.calibration.target.pdf import dark
from v3studio.studio.calibration.target.pose_graph import chain_poses
from v3studio.studio.cameras import Camera, Rig
from v3studio.studio.errors import Cancelled

CHARUCO = CalibrationTarget(columns=7, rows=5, square=0.05, marker=0.037)
RADIAL = CalibrateSettings(camera_model="RADIAL")
CHESS = CalibrationTarget(kind="chessboard", columns=8, rows=5, square=0.05)
SIZE = (640, 480)


def turned(x: float, y: float, z: float, middle: np.ndarray, target: CalibrationTarget) -> np.ndarray:
    """Target to world: the target's center at a position, rotated by a rotation vector from facing -y."""
    base = np.stack([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]], axis=1)  # columns: board's x, y (down), z (into it)
    placed = np.eye(4)
    placed[:3, :3] = cv2.Rodrigues(np.array([x, y, z]))[0] @ base
    placed[:3, 3] = middle - placed[:3, :3] @ target.middle
    return placed


def rig_of(count: int) -> Rig:
    """Cameras on an arc around the origin with different intrinsics."""
    cameras = []
    for index in range(count):
        angle = np.radians(-90 + 20 * (index - (count - 1) / 2))
        center = np.array([1.2 * np.cos(angle), 1.2 * np.sin(angle), 0.1 * (index % 2)])
        focal = 600.0 + 15 * index
        K = np.array([[focal, 0, 318.0 + 3 * index], [0, focal, 243.0 - 2 * index], [0, 0, 1]])
        distortion = np.array([-0.1 + 0.03 * index, 0.04, 0.0, 0.0])
        cameras.append(Camera(f"cam{index}", *SIZE, K, pose(center), distortion))
    return Rig(tuple(cameras))


def filmed(
    rig: Rig,
    target: CalibrationTarget,
    sync_frames: int,
    noise: float,
    seed: int = 0,
    reach: tuple[float, ...] = (1, 1, 1),
) -> tuple[dict, dict]:
    """Observations of a moving board, and its true poses."""
    rng = np.random.default_rng(seed)
    views, target_poses = {}, {}
    for sync_frame in range(sync_frames):
        target_pose = turned(
            *rng.uniform(-0.6, 0.6, 3), np.array(reach) * rng.uniform([-0.3, -0.2, -0.2], [0.3, 0.3, 0.2]), target
        )
        target_poses[sync_frame] = target_pose
        world = target.corners @ target_pose[:3, :3].T + target_pose[:3, 3]
        for camera in rig:
            pixels, _ = camera.project(world)
            pixels = pixels + rng.normal(0, noise, pixels.shape)
            inside = ((pixels > 2) & (pixels < np.array(SIZE) - 2)).all(1)
            if inside.sum() >= 12:
                views[sync_frame, camera.name] = TargetObservation(target, np.flatnonzero(inside), pixels[inside])
    return views, target_poses


def picture(target: CalibrationTarget, camera: Camera, target_pose: np.ndarray) -> np.ndarray:
    """Image of a board from a camera without distortion, drawn from our list of dark areas at four times the size."""
    fine = 4
    image = np.full((camera.height * fine, camera.width * fine), 225, np.uint8)

    for x, y, w, h in dark(target):
        corners = np.array([[x, y, 0], [x + w, y, 0], [x + w, y + h, 0], [x, y + h, 0]])
        pixels, _ = camera.project(corners @ target_pose[:3, :3].T + target_pose[:3, 3])
        # cv2 fills up to pixel centers: subtract half a fine pixel, with 8 fractional bits
        cv2.fillPoly(image, [np.round((pixels * fine - 0.5) * 256).astype(np.int32)], 25, cv2.LINE_8, 8)
    return cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("target", [CHARUCO, CHARUCO.replace(rows=6, legacy=True), CHESS])
@pytest.mark.parametrize("turn", [0.2, 2.0, -2.9])
def test_corners_are_where_the_camera_puts_them(target: CalibrationTarget, turn: float) -> None:
    """The target is found on its side and upside down, too; the pixel origin is the image corner."""
    camera = replace(rig_of(1)["cam0"], distortion=np.zeros(0))
    target_pose = turned(0.25, turn, 0.15, np.zeros(3), target)
    view = target.detect(picture(target, camera, target_pose))
    assert len(view.ids) > 0.9 * len(target.corners)
    exact, _ = camera.project(target.corners[view.ids] @ target_pose[:3, :3].T + target_pose[:3, 3])
    off = view.pixels - exact
    assert np.abs(off.mean(0)).max() < 0.06
    assert np.median(np.linalg.norm(off, axis=1)) < 0.2
    assert np.linalg.norm(off, axis=1).max() < 0.8


@pytest.mark.parametrize("target", [CHARUCO, CHARUCO.replace(rows=6, legacy=True, dictionary="DICT_5X5_100")])
def test_the_pattern_is_opencvs(target: CalibrationTarget) -> None:
    cells = 6 if "4X4" in target.dictionary else 7
    side = 10 * cells * 4
    target = target.replace(marker=target.square * 0.75)
    theirs = target.charuco.generateImage((target.columns * side, target.rows * side))
    ours = np.full_like(theirs, 255)
    for x, y, w, h in dark(target):
        x0, y0, x1, y1 = (round(value / target.square * side) for value in (x, y, x + w, y + h))
        ours[y0:y1, x0:x1] = 0
    assert (ours != theirs).mean() < 1e-3


def polygons(pdf: bytes) -> tuple[tuple[float, float], list[np.ndarray]]:
    """Page size and filled polygons of a PDF, in millimeters."""
    box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", pdf)
    assert box is not None
    point = 25.4 / 72
    shapes = []
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.S):
        text = zlib.decompressobj().decompress(stream).decode("latin-1") if stream.startswith(b"x") else ""
        if "CS" not in text:
            continue  # a glyph's outline
        for part in re.findall(r"((?:[-\d.]+ [-\d.]+ [ml]\s+){4,5})h?\s*f", text):
            numbers = np.array(re.findall(r"[-\d.]+", part), float).reshape(-1, 2)
            if np.ptp(numbers[:, 0]) < 0.99 * float(box[1]):  # not the white page itself
                shapes.append(numbers[:4] * point)
    return (float(box[1]) * point, float(box[2]) * point), shapes


def test_the_pdf_has_true_scale(tmp_path: Path) -> None:
    """OpenCV detects a board in the file's rectangles, drawn at 4 pixels per millimeter, at the correct position."""
    target = CalibrationTarget(columns=5, rows=4, square=0.03, marker=0.02)
    width, height = write_target_pdf(target, tmp_path / "board.pdf", paper="a4")
    (page_width, page_height), shapes = polygons((tmp_path / "board.pdf").read_bytes())
    assert (width, height) == (297, 210)
    assert (page_width, page_height) == pytest.approx((297, 210), abs=0.01)
    assert len(shapes) > 20
    image = np.full((210 * 4, 297 * 4), 255, np.uint8)
    for shape in shapes:
        corners = np.column_stack([shape[:, 0], page_height - shape[:, 1]]) * 4 - 0.5
        cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], 0, cv2.LINE_8, 4)
    view = target.detect(image)
    places = view.pixels[np.argsort(view.ids)].reshape(3, 4, 2) / 4
    np.testing.assert_allclose(np.diff(places[:, :, 0], axis=1), 30.0, atol=0.1)
    np.testing.assert_allclose(np.diff(places[:, :, 1], axis=0), 30.0, atol=0.1)
    again = tmp_path / "again.pdf"
    with matplotlib.rc_context({"text.usetex": True}):  # as by a file in the working folder; starts LaTeX
        write_target_pdf(target, again, paper="a4")
    assert again.read_bytes() == (tmp_path / "board.pdf").read_bytes()


def test_rig_from_a_target() -> None:
    """With 0.2 pixels of noise the cameras are within 6 mm, in meters, relative to the requested origin."""
    rig = rig_of(4)
    views, target_poses = filmed(rig, CHARUCO, 30, noise=0.2)
    said: list[int] = []
    result = calibrate_from_target(
        CHARUCO, views, dict.fromkeys(rig.names, SIZE), settings=RADIAL.replace(board_origin=3, board_upright=True),
        threads=1, progress=lambda done, total, **figures: said.append(done),
    )  # fmt: skip
    assert result.rig.names == rig.names
    # the world defined by the target of frame 3: x from column to column, z up the columns, y away from the viewer
    target_pose = target_poses[3]
    middle = target_pose[:3, :3] @ CHARUCO.middle + target_pose[:3, 3]
    axes = np.stack([target_pose[:3, 0], target_pose[:3, 2], -target_pose[:3, 1]])
    for camera in rig:
        estimated = result.rig[camera.name]
        assert np.linalg.norm(estimated.center - axes @ (camera.center - middle)) < 0.006
        assert np.degrees(np.arccos(np.clip(estimated.forward @ (axes @ camera.forward), -1, 1))) < 0.3
        assert estimated.fx == pytest.approx(camera.fx, rel=0.005)
        assert (estimated.cx, estimated.cy) == pytest.approx((camera.cx, camera.cy), abs=2.5)
        assert estimated.distortion[0] == pytest.approx(camera.distortion[0], abs=0.02)
    assert 0.15 < result.report.reprojection.mean < 0.3  # the noise only
    assert result.report.metric is True
    figures = result.report.target
    assert abs(figures.scale_bias) < 0.002
    assert figures.corner_error_mm < 1
    assert said == sorted(said)
    assert CalibrationReport.model_validate_json(result.report.model_dump_json(exclude_unset=True)) == result.report


def test_observations_out_of_sync_are_rejected() -> None:
    """One camera is late in every third sync frame, so it sees the target elsewhere: the rig remains accurate."""
    rig = rig_of(3)
    views, target_poses = filmed(rig, CHARUCO, 24, noise=0.1)
    camera = rig["cam1"]
    for sync_frame in range(0, 24, 3):
        if (sync_frame, "cam1") in views:
            later = target_poses[sync_frame].copy()
            later[:3, 3] += [0.012, 0, 0.006]
            ids = views[sync_frame, "cam1"].ids
            pixels, _ = camera.project(CHARUCO.corners[ids] @ later[:3, :3].T + later[:3, 3])
            views[sync_frame, "cam1"] = TargetObservation(CHARUCO, ids, pixels)
    result = calibrate_from_target(CHARUCO, views, dict.fromkeys(rig.names, SIZE), settings=RADIAL, threads=1)
    assert result.report.target.views_left_out == pytest.approx(8, abs=1)
    assert compare_rigs(result.rig, rig).rotation_degrees < 0.4
    distances = [np.linalg.norm(r["cam0"].center - r["cam2"].center) for r in (result.rig, rig)]
    assert distances[0] == pytest.approx(distances[1], rel=0.005)


def test_known_intrinsics_are_kept_and_chains_reach_all_cameras() -> None:
    """cam0 and cam2 never see the board together, cam1 sees it with both."""
    rig = rig_of(3)
    views, _ = filmed(rig, CHARUCO, 20, noise=0.05)
    even = {"cam0": (0,), "cam1": (0, 1), "cam2": (1,)}
    views = {key: view for key, view in views.items() if key[0] % 2 in even[key[1]]}
    result = calibrate_from_target(CHARUCO, views, dict.fromkeys(rig.names, SIZE), settings=RADIAL)
    distance = np.linalg.norm(result.rig["cam0"].center - result.rig["cam2"].center)
    assert distance == pytest.approx(np.linalg.norm(rig["cam0"].center - rig["cam2"].center), abs=0.002)
    apart = {key: view for key, view in views.items() if key[1] != "cam1"}
    with refuses("target.not_connected", camera="cam2", cameras=["cam2"]):
        calibrate_from_target(CHARUCO, apart, {"cam0": SIZE, "cam2": SIZE})
    noise = np.random.default_rng(0).normal(0, 60, CHARUCO.corners[:, :2].shape)
    own = {key: view for key, view in views.items() if key[1] == "cam0"}
    wrong = {key: replace(view, pixels=view.pixels + noise[view.ids]) for key, view in own.items()}
    with refuses("target.no_fit", value=len(wrong), camera="cam0"):
        chain_poses({"cam0": rig["cam0"]}, wrong)


def test_intrinsics_alone_agree_with_opencv() -> None:
    """The result is compared with cv2.calibrateCamera with the same model and corners."""
    rig = rig_of(1)
    views, _ = filmed(rig, CHESS, 15, noise=0.1)
    seen = list(views.values())
    settings = CalibrateSettings(camera_model="OPENCV")
    intrinsics, figures = calibrate_intrinsics({"cam0": seen}, {"cam0": SIZE}, settings, threads=1)
    world = [CHESS.corners[view.ids].astype(np.float32) for view in seen]
    pixels = [(view.pixels - 0.5).astype(np.float32) for view in seen]
    _, K, distortion, _, _ = cv2.calibrateCamera(world, pixels, SIZE, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3)
    estimated = intrinsics["cam0"]
    np.testing.assert_allclose(estimated.cv2_K, K, atol=0.3)
    np.testing.assert_allclose(estimated.distortion, np.ravel(distortion)[:4], atol=3e-3)
    assert figures["cam0"].views == 15
    assert figures["cam0"].mean < 0.2


def test_of_many_views_the_most_different_are_used() -> None:
    views = list(filmed(rig_of(1), CHESS, 15, noise=0.1)[0].values())
    chosen = most_different(views * 8, SIZE)
    assert len(chosen) == MOST_VIEWS
    assert {id(view) for view in chosen} == {id(view) for view in views}
    close = [replace(views[0], pixels=views[0].pixels + 0.1 * number) for number in range(MOST_VIEWS)]
    chosen = most_different([*close, *views[1:]], SIZE)
    assert {id(view) for view in views[1:]} < {id(view) for view in chosen}
    assert len({id(view) for view in chosen}) == MOST_VIEWS


def test_detection_reads_every_image_and_can_be_stopped() -> None:
    camera = replace(rig_of(1)["cam0"], distortion=np.zeros(0))
    image = picture(CHARUCO, camera, turned(0.2, 0.1, 0, np.zeros(3), CHARUCO))
    blank = np.full_like(image, 90)
    views, sizes = detect_target({"a": lambda sync_frame: image if sync_frame == 4 else blank}, {"a": [2, 4]}, CHARUCO)
    assert list(views) == [(4, "a")]
    assert sizes == {"a": SIZE}

    with pytest.raises(Cancelled):
        detect_target({"a": lambda sync_frame: image}, {"a": [1]}, CHARUCO, cancel_at(0))
    with refuses("target.image_size", value=[320, 240], camera="a", frame=2, expected=[640, 480]):
        detect_target({"a": lambda sync_frame: image if sync_frame == 1 else image[::2, ::2]}, {"a": [1, 2]}, CHARUCO)


def test_bad_input(tmp_path: Path) -> None:
    for names, values in (
        (["dictionary"], {"dictionary": "DICT_9X9"}), (["dictionary", "columns", "rows"], {"columns": 12, "rows": 10}),
        (["marker", "square"], {"marker": 0.06}), (["square"], {"square": 60}),
    ):  # fmt: skip
        with refuses_setting(*names):
            CalibrationTarget(**values)
    with refuses("target.too_large", value=pytest.approx([350, 250]), paper="a4"):
        write_target_pdf(CHARUCO, tmp_path / "x.pdf", paper="a4")
    assert not (tmp_path / "x.pdf").exists()
    rig = rig_of(2)
    views, _ = filmed(rig, CHARUCO, 6, noise=0.1)
    sizes = dict.fromkeys(rig.names, SIZE)
    with refuses("target.symmetric", value=[7, 5]):
        calibrate_from_target(CHESS.replace(columns=7), views, sizes)
    with refuses("target.not_seen", camera="other"):
        calibrate_from_target(CHARUCO, views, {**sizes, "other": SIZE})
    with refuses("target.origin", value=99, expected=5, setting="calibrate.board_origin"):
        calibrate_from_target(CHARUCO, views, sizes, settings=CalibrateSettings(board_origin=99))
    few = {key: view for key, view in views.items() if key[0] < 2}
    with refuses("target.too_few_views", value=2, camera="cam0", expected=3):
        calibrate_from_target(CHARUCO, few, sizes)


def test_fisheyes_are_recognized_by_their_error() -> None:
    """Of lenses that differ, that one is a fisheye that a fisheye fits much better."""
    usual, wide = rig_of(2)
    K, bent = np.array([[250.0, 0, 320.0], [0, 250.0, 240.0], [0, 0, 1]]), np.array([0.02, -0.01, 0.003, -0.001])
    rig = Rig((usual, replace(wide, K=K, distortion=bent, fisheye=True)))
    views, _ = filmed(rig, CHESS, 24, 0.1, reach=(5, 1, 3))
    result = calibrate_from_target(CHESS, views, dict.fromkeys(rig.names, SIZE), threads=1)
    assert [camera.fisheye for camera in result.rig] == [False, True]
    solved, true = (own[wide.name].rotation @ own[usual.name].rotation.T for own in (result.rig, rig))
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(solved @ true.T)[0])) < 1
    pixels = np.concatenate([view.pixels for (_, camera), view in views.items() if camera == wide.name])
    off = result.rig[wide.name].normalized(pixels) - rig[wide.name].normalized(pixels)
    assert np.median(np.abs(off)) * 250 < 1
