import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.events import warnings_in
from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.events import Warned
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.takes.take import Take
from v3studio.studio.calibration.coverage import ViewRange
from v3studio.studio.camera_files import read_rig


def test_the_stream_has_the_directions_of_the_training_cameras(copied: Path, take: Take) -> None:
    rig = read_rig(take.rig)
    found = ViewRange.from_json(json.loads((take.stream / "manifest.json").read_text())["metadata"]["view_range"])
    assert len(found.directions) == 5
    for name in ("cam0", "cam3"):
        assert found.angle_from(rig[name].center) < 0.1
    assert found.angle_from(rig["cam4"].center) > 30, "held out"
    assert np.linalg.norm(found.center) < 0.3

    assert status(take, settings_in(copied, "bake.view_range=none"))["train"].state == "done"
    run_take(copied, "bake.view_range=none", stages=("bake",))
    assert "view_range" not in json.loads((take.stream / "manifest.json").read_text())["metadata"]


def test_gaps_between_cameras_are_told(project: Path) -> None:
    def warned(*overrides: str) -> list[Warned]:
        return warnings_in(run_take(project, *overrides, stages=("calibrate", "initialize")), "coverage.gaps")

    assert not warned()
    (message,) = warned("capture.cameras=[cam0, cam1, cam2, cam4]")
    # three cameras, 60 degrees apart, each good for 45: 210 of 360 degrees
    assert message.fields["outside"] == pytest.approx(150 / 360, abs=0.03)
    assert "of the directions around the performer" in message.message
    assert message.fields["setting"] == "bake.view_range"
