"""What the dialog of a new take says about the footage."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from gui.presenters.run.new_take import NewTake


def test_the_camera_file_may_be_beside_the_footage(tmp_path: Path) -> None:
    """HiFi4G: transforms.json one level above the folder of the images."""
    pose = np.diag([1.0, -1, -1, 1]).tolist()
    common = {"transform_matrix": pose, "w": 32, "h": 24, "fl_x": 30, "fl_y": 30, "cx": 16, "cy": 12}
    frames = [{"file_path": f"images/{name}.png", **common} for name in ("0", "1")]
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": frames}))
    (tmp_path / "example").mkdir()
    for name in ("0", "1"):
        Image.new("RGB", (32, 24)).save(tmp_path / "example" / f"{name}.png")
    assert "Camera file: ../transforms.json." in NewTake(str(tmp_path / "example")).found()
    assert "Camera file: transforms.json." in NewTake(str(tmp_path)).found()
