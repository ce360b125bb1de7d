"""The stage `set`, in a room with a wall behind a person who is a red patch."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.studio.scenery.test_depths import before_wall
from v3studio.pipelines.config import Config, load_config
from v3studio.pipelines.events import Event, Progress
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.runs.runner import run, status
from v3studio.pipelines.takes.files.json_files import read_model
from v3studio.pipelines.takes.frames.take_set import take_set
from v3studio.pipelines.takes.results.stage_files import SetReport
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import write_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.errors import Cancelled
from v3studio.studio.scenery import set_splats

STAGES = ("calibrate", "set")
FRAMES = 4


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Four frames of four cameras, in which the person walks, and masks of them."""
    cameras, plates = before_wall()
    for camera in cameras[:4]:
        for frame in range(FRAMES):
            image, mask = plates[camera.name][..., ::-1].copy(), np.zeros((camera.height, camera.width), np.uint8)
            person = np.s_[30:70, 10 + 28 * frame : 26 + 28 * frame]
            image[person], mask[person] = (0, 0, 255), 255
            for kind, pixels in (("images", image), ("masks", mask)):
                path = tmp_path / kind / camera.name / f"{frame}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                assert cv2.imwrite(str(path), pixels)
    write_rig(Rig(tuple(cameras[:4])), tmp_path / "cameras.json")
    monkeypatch.setattr(set_splats, "_POINTS", 2000)
    few = {"keyframe_iterations": 30, "densify_from": 10, "densify_until": 25, "densify_every": 5}
    few |= {"densify_max_splats": 2500, "prune_finetune_iterations": 10}
    monkeypatch.setattr(set_splats, "SETTINGS", set_splats.SETTINGS.replace(**few))
    capture = {"capture.root": str(tmp_path), "capture.masks": "files", "capture.rig": "cameras.json"}
    return load_config(None, [*capture.items(), ("run.threads", 1)])


def test_a_set_is_estimated_outside_of_the_masks_resumed_and_left_out(
    room: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = Take.create(tmp_path / "take")
    found = run(take, room, stages=STAGES)["set"]
    splats = take_set(take)
    assert splats is not None
    assert len(splats) == found["splats"]
    colors = splats.sh[:, 0].numpy() * 0.28209479 + 0.5
    assert (colors[:, 0] - colors[:, 1:].max(1) > 0.6).mean() < 0.01, "nobody is in the set"
    assert set(read_model(take.set_report, SetReport).psnr) == {f"cam{number}" for number in range(4)}
    before = take.set_splats.read_bytes()
    events: list[Event] = []
    assert status(take, room)["set"].state == "done"

    # a run that was canceled goes on where it was, to the same bytes
    monkeypatch.setattr("v3studio.studio.training.settings.CHECKPOINT_EVERY", 2)
    cancellation, flagged = Cancellation(), []

    def stop(event: Event) -> None:
        if (take.work("set") / "checkpoint").is_file() and not flagged:
            flagged.append(event)
            cancellation.cancel()

    with pytest.raises(Cancelled):
        run(take, room, stop, stages=("set",), force=True, cancellation=cancellation)
    assert take.set_splats.read_bytes() == before, "the earlier result stays until then"
    take.forget("set")
    run(take, room, events.append, stages=("set",))
    assert take.set_splats.read_bytes() == before
    fractions = [event.fraction for event in events if isinstance(event, Progress)]
    assert fractions[-1] == 1.0
    assert fractions == sorted(fractions)
    assert not take.work("set").exists()

    none = room.replace(capture=room.capture.replace(set="none"))
    assert status(take, none)["set"].state == "stale"
    assert run(take, none, stages=("set",))["set"]["splats"] == 0
    assert take_set(take) is None
    assert read_model(take.set_report, SetReport).reason


@pytest.mark.parametrize("case", ["cut out", "one camera", "no masks"])
def test_where_the_footage_shows_no_set_there_is_none(room: Config, tmp_path: Path, case: str) -> None:
    changes: dict = {"cut out": {}, "one camera": {"cameras": ("cam0", "cam1")}, "no masks": {"masks": "none"}}[case]
    if case == "cut out":
        for path in (tmp_path / "images").rglob("*.png"):
            image = cv2.imread(str(path))
            image[(image != (0, 0, 255)).any(-1)] = 0
            assert cv2.imwrite(str(path), image)
    take = Take.create(tmp_path / "take")
    run(take, room.replace(capture=room.capture.replace(**changes)), stages=STAGES)
    assert take_set(take) is None
    assert read_model(take.set_report, SetReport).reason
