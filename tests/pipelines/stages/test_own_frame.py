"""A take 5,000 km from zero, in millimeters: as good as the same one in place, and exported where its cameras are."""

import json
import shutil
from pathlib import Path

import av
import numpy as np
from plyfile import PlyData

from tests.support.tiny_capture import Here
from v3studio.pipelines.takes.authored.edits import read_edits
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.similarity import Similarity

AWAY = Similarity(1000.0, np.eye(3), np.array([5.0e9, -1.2e9, 3.0e5]))


def exported(here, take: Path, out: Path, *options: str) -> np.ndarray:
    """(N, 3) float64 positions of the first frame."""
    here("export", take, "--format", "ply", "--out", out, "--frames", "0:1", *options).ok()
    rows = PlyData.read(str(next(out.iterdir())))["vertex"]
    return np.stack([np.asarray(rows[name], np.float64) for name in "xyz"], axis=1)


def test_a_take_far_away_in_other_units(here: Here, finished: Path, tmp_path: Path) -> None:
    project = tmp_path / "project"
    shutil.copytree(finished, project, ignore=shutil.ignore_patterns("take"))
    near, take = finished / "take", project / "take"
    rig = read_rig(project / "capture" / "cameras.json")
    write_rig(Rig(tuple(AWAY.camera(camera) for camera in rig)), project / "capture" / "away.json")
    here("run", project / "ball.yaml", "--take", take, "--capture.rig", "away.json").ok()
    given = read_rig(take / "calibrate" / "rig.json")
    np.testing.assert_allclose(given["cam1"].center, AWAY.points(rig["cam1"].center), rtol=1e-12)

    figures = [json.loads((place / "evaluation.json").read_text())["summary"]["psnr_decoded"] for place in (near, take)]
    assert abs(figures[0] - figures[1]) < 1.0  # of a training of seconds
    for of in ("trained", "decoded"):
        before = exported(here, near, tmp_path / f"near-{of}", "--of", of)
        after = exported(here, take, tmp_path / f"away-{of}", "--of", of)
        corners = [np.quantile(points, [0.05, 0.5, 0.95], axis=0) for points in (AWAY.points(before), after)]
        np.testing.assert_allclose(corners[1], corners[0], atol=100.0)  # of a ball of 1,100 mm

    middle = AWAY.points(np.zeros(3))
    corner = [str(value) for value in (*(middle - 900), "--max", *(middle + 900))]
    here("edit", "crop", take, "--min", *corner).ok()
    box = read_edits(take / "edits.json").crop
    assert np.abs(box.center).max() < 1  # in the take's own frame
    assert "box of 1800 x 1800 x 1800" in here("edit", "list", take).stdout
    path = tmp_path / "movie.mp4"
    options = ("--format", "camera-path", "--size", "64x48", "--seconds", "0.2")
    here("export", take, *options, "--path", take / "calibrate" / "rig.json", "--out", path).ok()
    with av.open(str(path)) as container:
        image = next(container.decode(video=0)).to_ndarray(format="rgb24")
    assert image.std() > 5  # the ball is seen
