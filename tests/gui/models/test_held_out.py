from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from v3studio.gui.models import held_out
from v3studio.gui.models.held_out import held_out_cameras
from v3studio.gui.models.scene.reader import SmallImages, small_image
from v3studio.studio.errors import StudioError


class Once:
    """Footage that cannot be read the first time."""

    def __init__(self, answer: object) -> None:
        self.answer, self.asked = answer, 0

    def __call__(self, *_: object) -> Any:
        self.asked += 1
        if self.asked == 1:
            raise StudioError("footage.folder_unreadable", "stale handle")
        return self.answer


def test_held_out_cameras_are_known_once_the_footage_can_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held_out, "camera_uses", Once({"cam1": "held out", "cam2": "training"}))
    config = SimpleNamespace(capture=SimpleNamespace(held_out=("named",)))
    context: Any = type("Context", (), {"capture": None, "config": config})()
    assert [held_out_cameras(context) for _ in range(3)] == [("named",), ("cam1",), ("cam1",)]


def test_images_are_shown_once_they_can_be_read() -> None:
    raw_image = Once(np.zeros((4, 6, 3), np.uint8))
    context: Any = SimpleNamespace(raw_footage=SimpleNamespace(frames=(7,), raw_image=raw_image))
    images = SmallImages(9)
    shown = [small_image(images, context, "cam1", 0) for _ in range(3)]
    assert [image is not None for image in shown] == [False, True, True]
    assert raw_image.asked == 2
