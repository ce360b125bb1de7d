"""The stage calibrate from tie points: the cameras, and the record that staleness is judged by."""

import json
from pathlib import Path

import numpy as np

from pipelines.config import load_config
from pipelines.runs.runner import run, status
from pipelines.takes.take import Take
from studio.calibration import align_rigs
from studio.camera_files import read_rig


def test_a_take_is_calibrated_from_tie_points(project: Path) -> None:
    truth = read_rig(project / "capture" / "cameras.json")
    positions = np.random.default_rng(0).uniform(-0.6, 0.6, (20, 3))
    points = {
        f"p{number:02d}": {"pixels": {camera.name: camera.project(position[None])[0][0].tolist() for camera in truth}}
        for number, position in enumerate(positions)
    }
    (project / "capture" / "points.yaml").write_text(json.dumps({"points": points}))
    overrides = {"capture.rig": None, "calibrate.tie_points": "points.yaml", "calibrate.known_cameras": "cameras.json"}
    config = load_config(project / "ball.yaml", overrides.items())
    take = Take.create(project / "take")
    run(take, config, lambda event: None, stages=("calibrate",))

    found = read_rig(take.rig)
    aligned = align_rigs(found, truth).rig(found)
    for camera in truth:
        assert np.linalg.norm(aligned[camera.name].center - camera.center) < 1e-3

    assert status(take, config)["calibrate"].state == "done"
