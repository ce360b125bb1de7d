"""Points of a calibration far from zero."""

from pathlib import Path

import numpy as np

from pipelines.takes.point_files import read_points, read_sparse_points, write_points
from studio.camera_files import write_rig
from tests.support.rigs import ring

FAR = np.array([5.0e6, -1.2e6, 300.0])


def test_points_of_a_calibration_keep_their_digits(tmp_path: Path) -> None:
    points = FAR + np.random.default_rng(0).normal(0, 0.5, (30, 3))
    write_points(tmp_path / "points.ply", points, None, np.full((30, 3), 128), doubles=True)
    np.testing.assert_array_equal(read_points(tmp_path / "points.ply")[0], points)
    write_rig(ring(6, target=FAR), tmp_path / "rig.json")
    near, colors = read_sparse_points(tmp_path / "points.ply", tmp_path / "rig.json")
    np.testing.assert_allclose(near, points - FAR, atol=1e-5)
    np.testing.assert_allclose(colors, 128 / 255, atol=1e-6)
