"""Calibration from tie points against synthetic rigs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.rigs import camera_at, on_circle
from v3studio.pipelines.reports.calibration import calibration_warnings
from v3studio.studio.calibration import (
    CalibrateSettings,
    TiePoint,
    calibrate_from_tie_points,
    compare_rigs,
    read_tie_points,
    write_tie_points,
)
from v3studio.studio.calibration.manual.bootstrap import Observations, TieRig
from v3studio.studio.calibration.manual.bundle_adjustment import Problem
from v3studio.studio.calibration.manual.covariance import check_plausible
from v3studio.studio.calibration.manual.subpixel import snap
from v3studio.studio.calibration.result import CalibrationResult
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import StudioError

WIDTH, HEIGHT = 1088, 1920


def ring(count: int, focal: float = 1600.0, k1: float = -0.05) -> Rig:
    """Cameras around a stage, far apart, about 1.7 m high."""
    cameras = []
    for number in range(count):
        center = on_circle(2 * np.pi * number / count + 0.1 * (number % 3), 3.5, 1.6 + 0.3 * (number % 2))
        lens = {"focal": focal, "size": (WIDTH, HEIGHT), "distortion": [k1, 0, 0, 0]}
        cameras.append(camera_at(f"{number:02d}", center, [0, 0, 0.6], **lens))
    return Rig(tuple(cameras))


def marked(
    rig: Rig, count: int, noise: float = 0.5, *, flat: bool = False, seen: float = 1.0, measured: int = 0
) -> list[TiePoint]:
    """Points on the stage, with noisy marks."""
    rng = np.random.default_rng(7)
    points3d = rng.uniform([-1, -1, 0], [1, 1, 0.01 if flat else 1.6], (count, 3))
    points = []
    for number, place in enumerate(points3d):
        pixels = {}
        for camera in rig:
            xy, depth = camera.project(place[None])
            if depth[0] > 0 and (xy > 0).all() and xy[0, 0] < WIDTH and xy[0, 1] < HEIGHT and rng.uniform() < seen:
                pixels[camera.name] = tuple((xy[0] + rng.normal(0, noise, 2)).tolist())
        world = tuple((place + rng.normal(0, 0.003, 3)).tolist()) if number < measured else None
        points.append(TiePoint(f"point {number}", pixels, world))
    return points


def sizes(rig: Rig) -> dict[str, tuple[int, int]]:
    return {camera.name: (camera.width, camera.height) for camera in rig}


def solve(points: list[TiePoint], truth: Rig, known: bool = True, **options: Any) -> CalibrationResult:
    intrinsics = {camera.name: camera for camera in truth} if known else None
    return calibrate_from_tie_points(points, sizes(truth), known=intrinsics, **options)


@pytest.mark.parametrize(
    ("count", "points", "options"),
    [(4, 12, {}), (4, 20, {"flat": True}), (12, 24, {"seen": 0.5}), (4, 12, {"measured": 5})],
)
def test_cameras_far_apart_with_known_intrinsics(count: int, points: int, options: dict) -> None:
    truth = ring(count)
    result = solve(marked(truth, points, **options), truth)
    assert result.rig.names == truth.names
    difference = compare_rigs(result.rig, truth)
    assert difference.center_percent < 0.4
    assert difference.rotation_degrees < 0.25
    assert 0.2 < result.report.reprojection.mean < 0.7  # half a pixel of noise in both directions
    assert result.report.left_out == []
    assert result.report.metric == ("measured" in options)
    assert result.report.known_intrinsics == list(truth.names)
    if "measured" in options:  # in world coordinates, without alignment
        for camera in truth:
            assert np.linalg.norm(result.rig[camera.name].center - camera.center) < 0.03
        assert 0 < result.report.tie_points["point 0"].off < 0.02


def test_intrinsics_that_are_not_known() -> None:
    truth = ring(4, focal=1300.0)
    result = solve(marked(truth, 24, 0.3), truth, known=False)
    assert result.rig.cameras[0].fx == result.rig.cameras[1].fx == pytest.approx(1300, rel=0.01)
    assert compare_rigs(result.rig, truth).center_percent < 0.6
    pinhole = CalibrateSettings(camera_model="SIMPLE_PINHOLE")
    plain = solve(marked(truth, 24, 0.3), truth, known=False, settings=pinhole)
    assert [camera.distortion.size for camera in plain.rig] == [0] * 4
    separate = CalibrateSettings(shared_intrinsics=False)
    own = solve(marked(truth, 40, 0.3), truth, known=False, settings=separate)
    assert len({camera.fx for camera in own.rig}) == 4
    assert all(camera.fx == pytest.approx(1300, rel=0.02) for camera in own.rig)


def test_marks_that_are_mistakes_are_left_out_by_name() -> None:
    truth = ring(4)
    points = marked(truth, 20)
    x, y = points[3].pixels["02"]
    points[3].pixels["02"] = (x + 60, y - 20)
    result = solve(points, truth)
    assert [(mark.point, mark.camera) for mark in result.report.left_out] == [("point 3", "02")]
    assert result.report.left_out[0].error > 30
    assert compare_rigs(result.rig, truth).center_percent < 0.4


def test_a_known_distance_gives_the_scale() -> None:
    truth = ring(4)
    away = float(np.linalg.norm(truth["00"].center - truth["02"].center))
    settings = CalibrateSettings(known_distance=("00", "02", away))
    result = solve(marked(truth, 16), truth, settings=settings)
    assert result.report.metric
    assert np.linalg.norm(result.rig["01"].center - result.rig["03"].center) == pytest.approx(
        np.linalg.norm(truth["01"].center - truth["03"].center), rel=0.005
    )


def test_the_derivatives_are_the_differences() -> None:
    truth = ring(3)
    points = marked(truth, 9, measured=4)
    pixels = {c.name: np.array([p.pixels.get(c.name, (np.nan, np.nan)) for p in points]) for c in truth}
    world = np.array([p.world or (np.nan,) * 3 for p in points])
    points3d = np.random.default_rng(1).uniform([-0.5, -0.5, 0], [0.5, 0.5, 1], (9, 3))
    rig = TieRig({camera.name: camera for camera in truth}, points3d, Observations([], world, pixels))
    problem = Problem(rig, [["00", "02"], ["01"]], True)
    start = problem.start() + 1e-3
    exact = problem.jacobian(start)
    for column in range(len(start)):
        step = np.zeros(len(start))
        step[column] = 1e-6
        slope = (problem.residuals(start + step) - problem.residuals(start - step)) / 2e-6
        assert np.allclose(exact[:, column], slope, rtol=1e-4, atol=1e-3 * np.abs(slope).max() + 1e-5), column


def test_what_is_missing_is_said() -> None:
    truth = ring(4)
    with refuses("tie_points.unregistered", value=list(truth.names), marks=dict.fromkeys(truth.names, 5)):
        solve(marked(truth, 5), truth)
    lonely = [TiePoint(p.name, {n: xy for n, xy in p.pixels.items() if n != "03"}) for p in marked(truth, 12)]
    with refuses("tie_points.unregistered", value=["03"], camera="03"):
        solve(lonely, truth)
    outside = [TiePoint("edge", {"00": (2000.0, 5.0)})]
    with refuses("tie_points.outside", value=[2000, 5], point="edge", camera="00", expected=[1088, 1920]):
        solve(outside, truth, known=False)
    with refuses("tie_points.none", expected=list(truth.names)):
        solve([TiePoint("elsewhere", {"x": (1.0, 2.0)})], truth, known=False)
    smaller = {camera.name: camera.resized(544, 960) for camera in truth}
    with refuses("calibration.intrinsics_size", value=[544, 960], camera="00", expected=[1088, 1920]):
        calibrate_from_tie_points(marked(truth, 9), sizes(truth), known=smaller)


@pytest.mark.parametrize("measured", [0, 12])
def test_points_on_a_line_are_refused(measured: int) -> None:
    truth = ring(4)
    rng = np.random.default_rng(3)
    points = []
    for number, place in enumerate(np.linspace([-0.8, -0.7, 0.1], [0.8, 0.6, 1.4], 12)):
        pixels = {c.name: tuple((c.project(place[None])[0][0] + rng.normal(0, 0.5, 2)).tolist()) for c in truth}
        points.append(TiePoint(f"point {number}", pixels, tuple(place.tolist()) if number < measured else None))
    with pytest.raises(StudioError) as caught:
        solve(points, truth)
    assert caught.value.code in ("tie_points.degenerate", "tie_points.contradiction")
    if caught.value.code == "tie_points.degenerate":
        assert "00" in caught.value.fields["cameras"]


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("measured", [5, 12])
def test_measured_positions_of_a_mirrored_world_are_refused(known: bool, measured: int) -> None:
    truth = ring(4)
    mirror = np.array([1, -1, 1])
    points = [
        point if point.world is None else replace(point, world=tuple((mirror * point.world).tolist()))
        for point in marked(truth, 20, measured=measured)
    ]
    with refuses("tie_points.contradiction") as caught:
        solve(points, truth, known)
    assert "right-handed with z up" in str(caught.value)


def test_points_behind_the_cameras_are_no_solution() -> None:
    truth = ring(3)
    points = marked(truth, 8, 0.0)
    observations = Observations(
        [point.name for point in points],
        np.full((8, 3), np.nan),
        {c.name: np.array([point.pixels[c.name] for point in points]) for c in truth},
    )
    turned = {c.name: replace(c, world_to_camera=np.diag([-1.0, 1, -1, 1]) @ c.world_to_camera) for c in truth}
    points3d = np.random.default_rng(2).uniform([-1, -1, 0], [1, 1, 1.6], (8, 3))
    with refuses("tie_points.behind"):
        check_plausible(TieRig(turned, points3d, observations))
    check_plausible(TieRig({c.name: c for c in truth}, points3d, observations))


def test_what_is_odd_is_warned_of() -> None:
    truth = ring(4)

    def warnings(points: list[TiePoint]) -> list[str]:
        return [message.code for message in calibration_warnings(solve(points, truth).report)]

    points = marked(truth, 20, measured=6)
    assert warnings(points) == []
    x, y, z = points[2].world or (0, 0, 0)
    off = [*points[:2], replace(points[2], world=(x + 0.4, y, z)), *points[3:]]
    message = next(
        warning
        for warning in calibration_warnings(solve(off, truth).report)
        if warning.code == "tie_points.world_error"
    )
    assert message.fields["points"][0] == "point 2", "the worst one first"
    large = [replace(p, world=p.world and tuple(1000 * value for value in p.world)) for p in points]
    assert "tie_points.unit" in warnings(large)
    smaller = [replace(p, pixels={n: (x / 2, y / 2) for n, (x, y) in p.pixels.items()}, world=None) for p in points]
    assert "tie_points.reprojection_error" in warnings(smaller)


def test_the_file_gives_back_what_was_written(tmp_path: Path) -> None:
    points = (
        TiePoint("corner: left, ä", {"01": (1.25, 2.5), "cam 2": (3.0, 4.75)}, (0.0, -0.3, 1.5), 12),
        TiePoint("7", {"01": (0.0, 0.5)}),
    )
    write_tie_points(points, tmp_path / "points.yaml")
    assert read_tie_points(tmp_path / "points.yaml") == points  # camera 01 stays 01, point 7 a name


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("points: [1, 2", "syntax", {"line": 1}),
        ("", "invalid", {"key": ""}),
        ("cameras: {}", "invalid", {"key": "points"}),
        ("points:\n  a: {cam01: [1, 2]}", "invalid", {"key": "points.a.pixels"}),
        ("points:\n  a: {pixels: {cam01: [1]}}", "invalid", {"key": "points.a.pixels.cam01.1"}),
        ("points:\n  a: {pixels: {cam01: [1, .nan]}}", "invalid", {"key": "points.a.pixels.cam01.1"}),
        ("points:\n  a: {pixels: {c: [1, 2]}, world: 5}", "invalid", {"key": "points.a.world"}),
        ("points:\n  a: {pixels: {c: [1, 2]}, frame: x}", "invalid", {"key": "points.a.frame"}),
        ("points:\n  a: {pixels: {c: [1, 2]}, xyz: 1}", "invalid", {"key": "points.a.xyz"}),
        ("points:\n  a: {pixels: {c: [1, 2]}}\n  a: {pixels: {}}", "syntax", {"line": 3}),
        ("\0\x80", "syntax", {}),
        (None, "unreadable", {}),
    ],
)
def test_files_that_are_broken(tmp_path: Path, text: str | None, code: str, fields: dict) -> None:
    path = tmp_path / "points.yaml"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with refuses(f"tie_points.{code}", file=path, **fields):
        read_tie_points(path)


def drawn(kind: str, center: np.ndarray, angle: float) -> np.ndarray:
    """A dot or corner at a known position, drawn at 8 times the size and averaged."""
    y, x = np.mgrid[:480, :480] / 8 + 1 / 16
    u = (x - center[0]) * np.cos(angle) + (y - center[1]) * np.sin(angle)
    v = -(x - center[0]) * np.sin(angle) + (y - center[1]) * np.cos(angle)
    inside = {"dot": u**2 + v**2 < 9, "corner": (u > 0) & (v > 0), "checkers": (u > 0) ^ (v > 0), "edge": u > 0}[kind]
    large = cv2.GaussianBlur(np.where(inside, 200, 60).astype(np.float32), (0, 0), 5)
    small = cv2.resize(large, None, fx=1 / 8, fy=1 / 8, interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(3).normal(0, 2, small.shape)
    return np.clip(small + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("kind", "within"), [("dot", 0.1), ("checkers", 0.1), ("corner", 0.3)])
def test_a_click_falls_on_the_corner_or_dot(kind: str, within: float) -> None:
    for angle in (0.1, 0.8, 2.0):
        center = np.array([30.3, 29.6])
        image = drawn(kind, center, angle)
        for off in ((2, 1), (-1.5, 2), (0, -2)):
            assert np.linalg.norm(np.array(snap(image, *(center + off))) - center) < within


def test_known_fisheyes_beside_others() -> None:
    """Marks in fisheyes are solved in their pinhole views."""
    rig = ring(5, k1=0.0)
    wide = {"distortion": np.array([0.02, -0.01, 0.003, 0.0]), "fisheye": True}
    rig = Rig(tuple(replace(camera, **wide) if camera.name in ("00", "02") else camera for camera in rig))
    result = calibrate_from_tie_points(
        marked(rig, 25), dict.fromkeys(rig.names, (WIDTH, HEIGHT)), known={camera.name: camera for camera in rig}
    )
    assert [camera.fisheye for camera in result.rig] == [True, False, True, False, False]
    assert compare_rigs(result.rig, rig).center_percent < 0.5
    np.testing.assert_array_equal(result.rig["00"].K, rig["00"].K)
