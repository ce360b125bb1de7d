"""Calibration reports compared with values computed by hand; the floor of a synthetic scene."""

import json

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.rigs import camera_at, ring
from v3studio.studio.calibration import floor_world, reprojection_report
from v3studio.studio.calibration.report import CalibrationReport
from v3studio.studio.calibration.result import image_coverage
from v3studio.studio.calibration.sfm.reconstruct import with_usual_focal
from v3studio.studio.cameras import Rig

K = np.array([[100.0, 0, 40], [0, 100, 30], [0, 0, 1]])
PLACES = {"east": [2, 0, 0], "north": [0, 2, 0], "west": [-1, 0, 0]}
RIG = Rig(tuple(camera_at(name, place, K=K, size=(80, 60)) for name, place in PLACES.items()))


def test_report_of_known_errors() -> None:
    """Two points; east observes both exactly, north both with an error of 0.6 px, west one with an error of 2 px."""
    points = np.array([[0.0, 0, 0], [0.1, 0.1, 0.1]])
    seen = {}
    for name, off, ids in (("east", 0.0, [0, 1]), ("north", 0.6, [0, 1]), ("west", 2.0, [0])):
        pixels = RIG[name].project(points[ids])[0] + [off, 0]
        seen[name] = np.column_stack([ids, pixels])
    report = reprojection_report(RIG, points, seen)
    assert report.reprojection.mean == pytest.approx((0 + 0 + 0.6 + 0.6 + 2) / 5, abs=1e-4)
    assert report.reprojection.median == pytest.approx(0.6, abs=1e-4)
    assert [report.cameras[name].mean for name in RIG.names] == pytest.approx([0, 0.6, 2], abs=1e-4)
    assert report.tracks == {"2": 1, "3": 1}
    assert report.mean_track_length == 2.5
    # the point in the middle is seen from both sides; the other along (1.9, -0.1, -0.1) and (-0.1, 1.9, -0.1)
    cosine = np.median([-1, (-0.19 - 0.19 + 0.01) / (1.9**2 + 0.02)])
    assert report.geometry.triangulation_angle == pytest.approx(np.degrees(np.arccos(cosine)), abs=0.01)
    grid = np.array(report.cameras["west"].coverage_map)
    assert np.argwhere(grid).tolist() == [[4, 4]]  # (42, 30) of 80 x 60
    written = report.model_dump_json(exclude_unset=True)
    assert CalibrationReport.model_validate_json(written) == report
    present = {"reprojection", "points", "observations", "mean_track_length", "tracks", "geometry", "cameras"}
    assert set(json.loads(written)) == present


def test_focal_lengths_that_are_unusual_among_cameras_of_one_size() -> None:
    """They are more than a factor of 1.6 from the median."""
    focal_lengths = {"a": 100.0, "b": 100, "c": 155, "d": 165, "e": 64, "f": 61, "g": 100}
    rig = Rig(
        tuple(
            camera_at(name, (2, 0, number), K=np.array([[focal, 0, 40], [0, focal, 30], [0, 0, 1]]), size=(80, 60))
            for number, (name, focal) in enumerate(focal_lengths.items())
        )
    )
    middle = np.zeros((1, 3))
    seen = {camera.name: np.column_stack([[0], camera.project(middle)[0]]) for camera in rig}
    report = with_usual_focal(reprojection_report(rig, middle, seen), rig)
    usual = {name: camera.usual_focal for name, camera in report.cameras.items() if camera.usual_focal is not None}
    assert usual == {"d": 100, "f": 100}


def test_coverage() -> None:
    assert image_coverage(np.zeros((0, 2)), (80, 60)) == 0
    assert image_coverage(np.array([[1.0, 1], [2, 2], [79.9, 59.9]]), (80, 60)) == 2 / 16


def test_the_floor_is_level_at_height_zero() -> None:
    rng = np.random.default_rng(0)
    tilt = np.radians(8)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    floor = np.column_stack([rng.uniform(-2, 2, (400, 2)), rng.normal(0, 0.003, 400)])
    wall = np.column_stack([rng.uniform(-2, 2, 300), np.full(300, 2.0), rng.uniform(0, 2, 300)])
    things = rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, 1.8], (300, 3))
    points = (np.concatenate([floor, wall, things]) + np.array([0, 0, 0.4])) @ turn.T
    rig = ring(6, heights=[0.5], target=(0, 0, 1), K=K, size=(80, 60))
    world, figures = floor_world(rig, points)
    moved = world.points(points)
    assert np.abs(moved[:400, 2]).max() < 0.03
    assert np.ptp(moved[400:700, 1]) < 0.05  # the wall is upright again
    assert figures.tilt == pytest.approx(8, abs=0.3)
    assert world.scale == 1
    with refuses("calibration.no_floor", setting="calibrate.floor", expected=0.05):
        floor_world(rig, rng.normal(size=(500, 3)))
    with refuses("calibration.no_floor", value=3, expected=50):
        floor_world(rig, points[:3])
