import json
from pathlib import Path

import cv2
import numpy as np

from tests.support.errors import refuses
from tests.support.rigs import intrinsics, ring
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.runner import run
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import write_rig


def test_masks_that_contradict_each_other_stop_it(tmp_path: Path) -> None:
    """Each of ten cameras has its performer somewhere else in the image."""
    rig = ring(10, heights=[0.5], K=intrinsics(100.0, (64, 48)), size=(64, 48))
    write_rig(rig, tmp_path / "rig.json")
    random = np.random.default_rng(0)
    for camera in rig:
        image = np.zeros((48, 64, 4), np.uint8)
        middle = int(random.integers(10, 54)), int(random.integers(10, 38))
        cv2.circle(image, middle, 6, (80, 120, 200, 255), -1)
        (tmp_path / "images" / camera.name).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "images" / camera.name / "000.png"), image)
    settings = tmp_path / "capture.yaml"
    settings.write_text("capture: {root: ., rig: rig.json, masks: alpha}\ninitialize: {resolution: 32}\n")
    take = Take(tmp_path / "take")
    with refuses("rig.wrong", setting="run.check_rig"):  # the images have too few features to say that it is the masks
        run(take, load_config(settings), lambda event: None, stages=("calibrate", "initialize"))
    stored = json.loads(take.rig_verdict.read_text())
    assert (stored["grade"], stored["blamed"]) == ("wrong", "cameras or masks")
