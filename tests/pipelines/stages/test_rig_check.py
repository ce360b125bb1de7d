"""Initialize stops if cameras, images and masks contradict each other."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.config import load_config
from pipelines.runs.runner import run
from pipelines.takes.take import Take
from studio.errors import StudioError


@pytest.fixture
def wrong_masks(project: Path) -> Path:
    """The project; each camera's performer is moved to another place of its image."""
    for number in range(6):
        for file in (project / "capture" / "images" / f"cam{number}").iterdir():
            image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            shift = np.array([[1.0, 0, (-20, 20)[number % 2]], [0, 1, 0]])
            moved = cv2.warpAffine(image, shift, (image.shape[1], image.shape[0]))
            cv2.imwrite(str(file), moved)
    return project


def test_masks_that_contradict_each_other_stop_it(wrong_masks: Path, tmp_path: Path) -> None:
    take = Take(tmp_path / "take")
    config = load_config(wrong_masks / "ball.yaml", [("capture.held_out", [])])
    with pytest.raises(StudioError) as stopped:
        run(take, config, lambda event: None, stages=("calibrate", "initialize"))
    assert stopped.value.code == "rig.wrong", "the images of a ball have too few features to say that it is the masks"
    assert stopped.value.fields["setting"] == "run.check_rig"
    stored = json.loads(take.rig_verdict.read_text())
    assert (stored["grade"], stored["blamed"]) == ("wrong", "cameras or masks")


def test_a_correct_rig_goes_through_and_is_judged_once(finished: Path) -> None:
    stored = json.loads(Take(finished / "take").rig_verdict.read_text())
    assert (stored["grade"], stored["blamed"]) == ("usable", ""), "nothing is called good without matches"
