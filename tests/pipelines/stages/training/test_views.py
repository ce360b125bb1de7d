from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from tests.support.rigs import camera_at
from tests.support.splats import round_splats
from tests.support.tiny_capture import settings_in
from v3studio.pipelines.config import Config
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.stages.training.plan import TrainPlan
from v3studio.pipelines.stages.training.views import ViewReader
from v3studio.pipelines.takes.authored.edits import change_edits
from v3studio.pipelines.takes.files.json_files import write_model
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, read_about, write_frame
from v3studio.pipelines.takes.results.stage_files import SetReport
from v3studio.pipelines.takes.take import Take
from v3studio.studio.camera_files import read_rig, write_rig
from v3studio.studio.cameras import Rig
from v3studio.studio.edits import DetailMark, EditList
from v3studio.studio.footage import FootageView
from v3studio.studio.training import TrainingView


def views_of(project: Path, *options: str) -> list[TrainingView]:
    take = Take.open(project / "take")
    mark = DetailMark(radius=0.1, path=((0, (0.0, 0.0, 0.0)),))
    change_edits(take.edits, EditList(details=(mark,)), "details")
    context = Inputs(take, settings_in(project, *options))
    return ViewReader.of(context).views(0, StageReporter("train"))


HALF = "capture.scale=0.5"


def test_details_are_also_seen_at_full_size(copied: Path) -> None:
    found = views_of(copied, HALF)
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


def test_they_show_what_was_filmed(copied: Path) -> None:
    for filmed, view in zip(views_of(copied, "train.crop_margin=10"), views_of(copied, HALF), strict=True):
        (closer,) = view.closer
        left, top = (round(float(filmed.camera.K[axis, 2] - closer.camera.K[axis, 2])) for axis in (0, 1))
        rows, columns = slice(top, top + closer.camera.height), slice(left, left + closer.camera.width)
        assert np.array_equal(closer.image.numpy(), filmed.image.numpy()[rows, columns])
        assert np.array_equal(closer.mask.numpy(), filmed.mask.numpy()[rows, columns])


@pytest.mark.parametrize("use_plates", [True, False])
def test_clean_plates_are_used_where_the_setting_says_so(use_plates: bool) -> None:
    camera = camera_at("cam0", (3.0, 0.0, 0.0))
    shape = (camera.height, camera.width)
    mask = np.zeros(shape, np.uint8)
    mask[10:20, 10:20] = 255
    plate = np.full((*shape, 3), 40, np.uint8)
    view = FootageView(camera, plate + 20, mask, 0, plate)
    footage = SimpleNamespace(train_cameras=("cam0",), view=lambda name, frame: view, chroma=lambda name: None)
    config = Config.model_validate({"train": {"use_plates": use_plates}})
    reader = ViewReader(cast(Any, footage), config.train, "cpu", 1.0, None, EditList(), {})
    (seen,) = reader.views(0, StageReporter("train"))
    assert (seen.plate is not None) == use_plates


def test_a_report_that_is_not_there_stops_training(take: Take, here: Callable[..., Any], tmp_path: Path) -> None:
    away = tmp_path / "report.json"
    frame, report = take.trained_frame(0, 0), take.initialize_group(0) / "report.json"
    key = read_about(frame).key  # type: ignore[union-attr]
    frame.unlink()
    report.rename(away)  # as another machine sees it that a network file system has not told of it yet
    here("train", take.root).fails("report.json: ")
    assert not frame.exists()
    away.rename(report)
    here("train", take.root).ok()
    assert read_about(frame).key == key  # type: ignore[union-attr]


def test_with_a_set_all_cameras_are_seen_before_it_and_frames_are_trained_again(copied: Path) -> None:
    take = Take.open(copied / "take")
    cut_out, keys = views_of(copied), TrainPlan(Inputs(take, settings_in(copied))).keys
    assert all(view.plate is None for view in cut_out)
    group = Inputs(take, settings_in(copied)).groups[0]
    before = keys(group)
    wall = round_splats(torch.zeros(1, 3), log_scale=3.0, opacity=0.99)
    write_frame(take.set_splats, wall, FrameMetadata())
    write_model(take.set_report, SetReport(splats=1))
    assert TrainPlan(Inputs(take, settings_in(copied))).keys(group) != before
    for view in views_of(copied):
        assert view.plate is not None
        assert view.doubted is not None
        assert view.doubted.shape == view.mask.shape
    assert all(view.plate is None for view in views_of(copied, "train.use_plates=false"))


def test_cameras_are_fitted_before_the_set_as_calibrated_whatever_an_earlier_fit_left(copied: Path) -> None:
    take = Take.open(copied / "take")
    write_frame(take.set_splats, round_splats(torch.zeros(1, 3), log_scale=-1.0, opacity=0.99), FrameMetadata())
    write_model(take.set_report, SetReport(splats=1))

    def plates(before_fits: bool) -> list[np.ndarray]:
        reader = ViewReader.of(Inputs(take, settings_in(copied)), before_fits=before_fits)
        seen = [view.plate for view in reader.views(0, StageReporter("train"))]
        return [plate.numpy() for plate in seen if plate is not None]

    calibrated = plates(before_fits=True)
    rig = read_rig(take.rig)
    aside = np.array([[0, 0, 9], [0, 0, 0], [0, 0, 0]])
    write_rig(Rig(tuple(replace(camera, K=camera.K + aside) for camera in rig), rig.notes), take.refined_rig)
    assert len(calibrated) == 5
    again, refined = plates(before_fits=True), plates(before_fits=False)
    assert [np.array_equal(*pair) for pair in zip(again, calibrated, strict=True)] == [True] * 5
    assert [np.array_equal(*pair) for pair in zip(refined, calibrated, strict=True)] == [False] * 5
