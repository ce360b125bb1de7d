"""Few cameras: a warning, and what the stream says about views that were not filmed."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.config import load_config, parse_override
from pipelines.events import Warned
from pipelines.runs.runner import run, status
from pipelines.takes.take import Take
from studio.camera_files import read_rig
from studio.coverage import ViewRange


def test_the_stream_has_the_directions_of_the_training_cameras(finished: Path, tmp_path: Path) -> None:
    take = Take.open(finished / "take")
    rig = read_rig(take.rig)
    found = ViewRange.from_json(json.loads((take.stream / "manifest.json").read_text())["metadata"]["view_range"])
    assert len(found.directions) == 5
    for name in ("cam0", "cam3"):
        assert found.angle_from(rig[name].center) < 0.1
    assert found.angle_from(rig["cam4"].center) > 30, "held out"
    assert np.linalg.norm(found.center) < 0.3

    shutil.copytree(finished, tmp_path / "copy")
    copy = Take.open(tmp_path / "copy" / "take")
    config = load_config(finished / "ball.yaml", [parse_override("bake.view_range=none")])
    assert status(copy, config)["train"].state == "done"
    run(copy, config, lambda event: None, stages=("bake",))
    assert "view_range" not in json.loads((copy.stream / "manifest.json").read_text())["metadata"]


def test_gaps_between_cameras_are_told(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "copy")

    def warned(*overrides: str) -> list[Warned]:
        events: list = []
        config = load_config(tmp_path / "copy" / "ball.yaml", [parse_override(text) for text in overrides])
        take = Take.create(tmp_path / f"take{len(overrides)}")
        run(take, config, events.append, stages=("calibrate", "initialize"))
        return [event for event in events if isinstance(event, Warned) and event.code == "coverage.gaps"]

    assert not warned()
    (message,) = warned("capture.cameras=[cam0, cam1, cam2, cam4]")
    # three cameras, 60 degrees apart, each good for 45: 210 of 360 degrees
    assert message.fields["outside"] == pytest.approx(150 / 360, abs=0.03)
    assert "of the directions around the performer" in message.message
    assert message.fields["setting"] == "bake.view_range"
