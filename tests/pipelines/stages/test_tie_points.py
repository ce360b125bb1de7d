"""Calibration from tie points as a stage: what a user types, and what the take then holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import yaml

from studio.calibration import align_rigs
from studio.camera_files import read_rig
from tests.pipelines.conftest import v3studio


def test_a_take_is_calibrated_from_tie_points(project: Path) -> None:
    truth = read_rig(project / "capture" / "cameras.json")
    positions = np.random.default_rng(0).uniform(-0.6, 0.6, (20, 3))
    points = {
        f"p{number:02d}": {
            "pixels": {camera.name: camera.project(position[None])[0][0].tolist() for camera in truth},
        }
        for number, position in enumerate(positions)
    }
    (project / "capture" / "points.yaml").write_text(yaml.safe_dump({"points": points}))
    take = project / "take"
    settings = ["--capture.rig=null", "--calibrate.tie_points=points.yaml", "--calibrate.known_cameras=cameras.json"]
    done = v3studio("calibrate", project / "ball.yaml", "--take", take, *settings)
    assert done.returncode == 0, done.stderr

    found = read_rig(take / "calibrate" / "rig.json")
    aligned = align_rigs(found, truth).rig(found)
    for camera in truth:
        assert np.linalg.norm(aligned[camera.name].center - camera.center) < 1e-3

    status = json.loads(v3studio("status", take, "--json").stdout)
    (calibrate,) = [stage for stage in status["stages"] if stage["stage"] == "calibrate"]
    assert calibrate["state"] == "done"
