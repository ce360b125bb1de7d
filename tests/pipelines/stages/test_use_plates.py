"""What training takes from the footage."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pipelines.config import Config
from pipelines.stages.reporter import StageReporter
from pipelines.stages.training_views import training_views
from studio.edits import EditList
from tests.support.rigs import camera_at


@pytest.mark.parametrize("use_plates", [True, False])
def test_clean_plates_are_used_where_the_setting_says_so(use_plates: bool) -> None:
    camera = camera_at("cam0", (3.0, 0.0, 0.0))
    shape = (camera.height, camera.width)
    mask = np.zeros(shape, np.uint8)
    mask[10:20, 10:20] = 255
    plate = np.full((*shape, 3), 40, np.uint8)
    view = SimpleNamespace(camera=camera, image=plate + 20, mask=mask, plate=plate)
    footage = SimpleNamespace(train_cameras=("cam0",), view=lambda name, frame: view, chroma=lambda name: None)
    config = Config()
    config = config.model_copy(update={"train": config.train.model_copy(update={"use_plates": use_plates})})
    context = SimpleNamespace(
        config=config,
        footage=SimpleNamespace(trained=footage, raw=SimpleNamespace(frames=range(1))),
        edits=EditList(),
        training_box=None,
        device="cpu",
    )
    (found,) = training_views(cast(Any, context), StageReporter("train"), 0, lambda number, images: None)
    assert (found.plate is not None) == use_plates
