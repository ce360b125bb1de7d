"""Regression of rate and quality: bytes, PSNR and errors against recorded figures.

After a change that is meant to alter them: `python -m tests.studio.stream.test_rate_and_quality --record`.
"""

import json
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.support.performer import attribute_errors, performer
from tests.support.rigs import ring
from v3studio.studio.metrics import psnr
from v3studio.studio.rasterizer import rasterize
from v3studio.studio.stream import BakeSettings, StreamReader, bake_group, write_manifest

RECORDED = Path(__file__).with_name("rate_and_quality.json")
CASES: dict[str, dict[str, Any]] = {
    "QP 20": {},
    "QP 30": {"quality": 30},
}


def measured(settings: dict[str, Any], folder: Path) -> dict[str, float]:
    """Bytes, mean PSNR of the decoded splats as drawn against the originals as drawn, and attribute errors."""
    frames = performer(5, 600)
    chosen = BakeSettings.model_validate({"quality": 20, "preset": "veryfast", **settings})
    entry = bake_group(frames, folder, 0, 0, chosen, fps=25.0)
    write_manifest(folder, [entry], 25, chosen)
    with StreamReader.open(folder) as reader:
        decoded = list(reader.iterate())
    levels = []
    with torch.no_grad():
        for frame, found in zip(frames, decoded, strict=True):
            for camera in ring(2, radius=1.6):
                one, two = (rasterize(splats, camera).image for splats in (frame, found))
                levels.append(float(psnr(one, two)))
    figures = attribute_errors(frames, decoded)
    return {"bytes": sum(file.bytes for file in entry.files), "psnr": sum(levels) / len(levels), **figures}


@pytest.mark.parametrize("name", CASES)
def test_within_one_percent_of_the_record(name: str, tmp_path: Path) -> None:
    record, found = json.loads(RECORDED.read_text())[name], measured(CASES[name], tmp_path)
    assert found.keys() == record.keys()
    for figure, value in found.items():
        assert math.isclose(value, record[figure], rel_tol=0.01), f"{figure}: {value} instead of {record[figure]}"


if __name__ == "__main__" and "--record" in sys.argv:
    found: dict[str, dict[str, float]] = {}
    for case, values in CASES.items():
        with tempfile.TemporaryDirectory() as made:
            found[case] = {figure: float(f"{value:.5g}") for figure, value in measured(values, Path(made)).items()}
    RECORDED.write_text(json.dumps(found, indent=1) + "\n")
