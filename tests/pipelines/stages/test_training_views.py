"""Views of a frame for training, with details at the size of the footage."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.config import load_config, parse_override
from pipelines.stages.inputs import Inputs
from pipelines.stages.reporter import StageReporter
from pipelines.stages.training_views import training_views
from pipelines.takes.edits import change_edits
from pipelines.takes.take import Take
from studio.edits import DetailMark, EditList
from studio.training import TrainingView


@pytest.fixture
def project(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "project")
    return tmp_path / "project"


def views_of(
    project: Path, *options: str, details: int = 1, colored: bool = True, detailed: bool = True
) -> list[TrainingView]:
    take = Take.open(project / "take")
    mark = DetailMark(radius=0.1, path=((0, (0.0, 0.0, 0.0)),))
    change_edits(take.edits, EditList(details=(mark,) * details), "details")
    context = Inputs(take, load_config(project / "ball.yaml", [parse_override(one) for one in options]))
    return training_views(
        context, StageReporter("train"), 0, lambda number, images: None, colored=colored, detailed=detailed
    )


HALF = "capture.scale=0.5"


def test_details_are_also_seen_at_full_size(project: Path) -> None:
    found = views_of(project, HALF)
    assert len(found) == 5
    for view in found:
        (closer,) = view.closer
        assert closer.camera.name == view.camera.name
        assert closer.camera.fx == pytest.approx(2 * view.camera.fx)
        # the detail fills the image
        (x, y), depth = (one[0] for one in closer.camera.project(np.zeros((1, 3))))
        reach = closer.camera.fx * 0.1 / depth
        assert (x, y) == pytest.approx((closer.camera.width / 2, closer.camera.height / 2), abs=2)
        assert closer.camera.width == pytest.approx(2 * reach, abs=4)


def test_they_show_what_was_filmed(project: Path) -> None:
    for filmed, view in zip(views_of(project, "train.crop_margin=10"), views_of(project, HALF), strict=True):
        (closer,) = view.closer
        left, top = (round(float(filmed.camera.K[axis, 2] - closer.camera.K[axis, 2])) for axis in (0, 1))
        rows, columns = slice(top, top + closer.camera.height), slice(left, left + closer.camera.width)
        assert np.array_equal(closer.image.numpy(), filmed.image.numpy()[rows, columns])
        assert np.array_equal(closer.mask.numpy(), filmed.mask.numpy()[rows, columns])
