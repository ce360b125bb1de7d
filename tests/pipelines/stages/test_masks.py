"""Takes with generated masks: by a matting model, and by keying."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipelines.config import load_config
from pipelines.runs.runner import status
from pipelines.takes.point_files import read_points
from pipelines.takes.take import Take

MODELS = Path(__file__).parents[2] / "studio" / "masks" / "data"
RADIUS = 0.55  # of the ball


def put_before(behind: tuple[int, int, int], capture: Path, saturation: float = 1.0) -> None:
    """The ball's images without an alpha channel, over a color, with noise; the ball less saturated."""
    random = np.random.default_rng(0)
    for path in capture.glob("images/*/*.png"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)
        cover = image[..., 3:] / 255
        ball = saturation * image[..., :3] + (1 - saturation) * image[..., :3].mean(axis=2, keepdims=True)
        mixed = ball * cover + np.array(behind) * (1 - cover) + random.normal(0, 1.5, (*image.shape[:2], 3))
        assert cv2.imwrite(str(path), np.clip(np.rint(mixed), 0, 255).astype(np.uint8))


def radii(take: Path) -> np.ndarray:
    points, _ = read_points(take / "initialize" / "group_000" / "points.ply")
    return np.linalg.norm(points, axis=1)


def test_a_take_with_a_matting_model(project: Path, here: Callable[..., Any]) -> None:
    """The model outputs the image's brightness, and the ball is white before black."""
    put_before((0, 0, 0), project / "capture")
    for path in (project / "capture").glob("images/*/*.png"):
        cv2.imwrite(str(path), np.where(cv2.imread(str(path)).max(axis=2, keepdims=True) > 20, 255, 0).repeat(3, 2))
    model = project / "capture" / "models" / "one.onnx"
    model.parent.mkdir()
    shutil.copy(MODELS / "free.onnx", model)
    command = ("run", project / "ball.yaml", "--take", project / "take", "--until", "initialize")
    command += ("--capture.masks", "model", "--capture.mask-model", "plain:models/one.onnx")
    here(*command).ok()
    assert np.median(radii(project / "take")) == pytest.approx(RADIUS, abs=0.05)
    take = Take.open(project / "take")
    kept = {path: path.stat().st_mtime_ns for path in (take.footage_cache / "masks").iterdir()}
    assert kept
    config = load_config(take.config)
    assert status(take, config)["initialize"].state == "done"
    shutil.copy(MODELS / "fixed.onnx", model)  # another file of the same name
    assert status(take, config)["initialize"].state == "stale"
    here(*command).ok()
    assert len(list((take.footage_cache / "masks").iterdir())) == 2 * len(kept)
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
