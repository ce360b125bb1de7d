import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.errors import refuses
from v3studio.pipelines.events.cancellation import Cancellation
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.footage_check import footage_check
from v3studio.studio.capture import CaptureSettings
from v3studio.studio.errors import Cancelled
from v3studio.studio.footage import Footage, open_footage


@pytest.fixture
def footage(tmp_path: Path) -> Footage:
    """Two cameras, three frames, each with a mask."""
    mask = np.zeros((48, 64), np.uint8)
    mask[10:30, 10:30] = 255
    for camera in ("left", "right"):
        for kind, image in (("images", np.full((48, 64, 3), 90, np.uint8)), ("masks", mask)):
            (tmp_path / kind / camera).mkdir(parents=True)
            for frame in range(3):
                cv2.imwrite(str(tmp_path / kind / camera / f"{frame:03d}.png"), image)
    return open_footage(CaptureSettings(root=tmp_path, masks="files"))


def test_a_problem_ends_training_and_is_reported(footage: Footage, tmp_path: Path) -> None:
    (tmp_path / "images" / "right" / "002.png").write_bytes(b"not an image")
    stop, reporter = Cancellation(), StageReporter("train")
    with refuses("footage.image_unreadable", count=1), footage_check(footage, (0, 1, 2), stop, reporter):
        while True:  # training, which only ends when it is told to
            stop.check()


def test_cancelling_ends_the_check(footage: Footage) -> None:
    reporter = StageReporter("train")

    def train() -> None:
        with footage_check(footage, (0, 1, 2), Cancellation(), reporter):
            reporter.cancellation.cancel()
            raise Cancelled

    with pytest.raises(Cancelled):
        train()
    assert not any(thread.name.startswith("check") for thread in threading.enumerate())
