import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.tiny_capture import RADIUS
from v3studio.pipelines.config import load_config
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.takes.results.point_files import read_points
from v3studio.pipelines.takes.take import Take

MODELS = Path(__file__).parents[2] / "studio" / "masks" / "data"


def test_a_take_with_a_matting_model(project: Path, here: Callable[..., Any]) -> None:
    """The model outputs the image's brightness, and the ball is white before black."""
    for path in (project / "capture").glob("images/*/*.png"):
        assert cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., 3:].repeat(3, 2))
    model = project / "capture" / "models" / "one.onnx"
    model.parent.mkdir()
    shutil.copy(MODELS / "free.onnx", model)
    command = ("run", project / "ball.yaml", "--take", project / "take", "--until", "initialize")
    command += ("--capture.masks", "model", "--capture.mask-model", "plain:models/one.onnx")
    here(*command).ok()
    take = Take.open(project / "take")
    points, _ = read_points(take.initialize_group(0) / "points.ply")
    assert np.median(np.linalg.norm(points, axis=1)) == pytest.approx(RADIUS, abs=0.05)
    kept = {path: path.stat().st_mtime_ns for path in (take.footage_cache / "masks").iterdir()}
    assert kept
    config = load_config(take.config)
    assert status(take, config)["initialize"].state == "done"
    shutil.copy(MODELS / "fixed.onnx", model)  # another file of the same name
    assert status(take, config)["initialize"].state == "stale"
    here(*command).ok()
    assert len(list((take.footage_cache / "masks").iterdir())) == 2 * len(kept)
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
