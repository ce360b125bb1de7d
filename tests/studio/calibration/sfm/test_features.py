"""Features are detected in every image."""

import sqlite3
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from studio.calibration.sfm.features import file_name, find_matches
from studio.calibration.sfm.job import SfmCamera, SfmJob


def test_an_image_that_was_left_out_is_looked_at_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    rng = np.random.default_rng(0)
    (tmp_path / "images").mkdir()
    texture = sum(cv2.GaussianBlur(rng.normal(size=(150, 200, 3)), (0, 0), s) * s * 70 for s in (1.5, 3, 6))
    for number in range(2):
        picture = np.clip(128 + texture, 0, 255) if number == 0 else np.full((150, 200, 3), 99)  # without a feature
        cv2.imwrite(str(tmp_path / "images" / file_name(number, 0)), picture.astype(np.uint8))
    one = SfmCamera(model="SIMPLE_RADIAL", width=200, height=150, params=(240.0, 100.0, 75.0, 0.0))
    job = SfmJob(
        names=("a", "b"),
        intrinsics=(one,) * 2,
        intrinsics_of=(0, 1),
        max_features=300,
        max_image_size=200,
    )
    calls: list[list[str]] = []
    real = pycolmap.extract_features

    def forgetful(*arguments: Any, image_names: list[str], **options: Any) -> None:
        calls.append(image_names)
        real(*arguments, image_names=image_names[1:] if len(calls) == 1 else image_names, **options)

    monkeypatch.setattr(pycolmap, "extract_features", forgetful)
    database = find_matches(tmp_path, job)
    assert len(calls) == 2
    with sqlite3.connect(database) as connection:
        rows = dict(connection.execute("SELECT image_id, rows FROM keypoints"))
    assert rows[1] > 50
    assert rows[2] == 0

    monkeypatch.setattr(pycolmap, "extract_features", real)
    assert find_matches(tmp_path, job).exists()
