"""The evaluation against uncut footage, and of masks that contradict it."""

import html
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.tiny_capture import CAMERAS, settings_in
from v3studio.pipelines.events import Event, Warned
from v3studio.pipelines.reports.tables import print_evaluation
from v3studio.pipelines.stages import evaluate
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.frames.frame_files import FrameMetadata, read_frame, write_frame
from v3studio.pipelines.takes.results.evaluation import Evaluation, read_evaluation
from v3studio.pipelines.takes.take import Take
from v3studio.studio.comparison.metrics import UNCUT
from v3studio.studio.footage import Footage

DAMAGED = 2  # a frame


def evaluated(project: Path) -> tuple[Evaluation, list[Event]]:
    events: list[Event] = []
    take = Take.open(project / "take")
    evaluate.run(Inputs(take, settings_in(project)), StageReporter("evaluate", events.append), None)
    return read_evaluation(take.evaluation), events


def test_masks_that_lost_a_part_are_named_everywhere(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, events = evaluated(copied)
    assert not before.masks.contradictions
    assert before.masks.cameras == CAMERAS
    for camera in CAMERAS:
        path = copied / "capture" / "images" / camera / f"{DAMAGED:03d}.png"
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image is not None
        rows = np.flatnonzero((image[..., 3] > 0).any(1))
        image[rows[0] + len(rows) // 3 : rows[0] + 2 * len(rows) // 3, :, 3] = 0
        assert cv2.imwrite(str(path), image)
    after, events = evaluated(copied)
    assert {(each.frame, each.camera, each.kind) for each in after.masks.contradictions} == {
        (DAMAGED, camera, "missing") for camera in CAMERAS
    }
    assert all(0.2 < each.share < 0.6 for each in after.masks.contradictions)
    assert after.summary.frames_contradicting_masks == 1
    warned = [event for event in events if isinstance(event, Warned)]
    assert [(event.code, event.fields["frames"]) for event in warned] == [("evaluation.masks_contradicted", [DAMAGED])]
    assert warned[0].message.startswith(after.masks.words)
    old, new = before.frames[DAMAGED].measures, after.frames[DAMAGED].measures
    assert new["psnr_picture_decoded"] == pytest.approx(old["psnr_picture_decoded"], abs=0.5), "the picture is the same"
    assert abs(new["psnr_decoded"] - old["psnr_decoded"]) > 1, "the mask's own figures are not"
    take = Take.open(copied / "take")
    print_evaluation(take)
    assert after.masks.words in capsys.readouterr().out.replace("\n", "")
    assert after.masks.words in html.unescape(take.report.read_text())


def test_whole_pictures_of_cameras_without_masks_are_compared_with_the_set(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = Take.open(copied / "take")
    around = read_frame(take.trained_frame(0, 0))
    around.means = around.means * 3
    write_frame(take.set_splats, around, FrameMetadata())
    monkeypatch.setattr(Footage, "unmasked_cameras", property(lambda footage: footage.held_out_cameras))
    after, _ = evaluated(copied)
    assert after.protocol.cameras == tuple(name for name in CAMERAS if name != "cam4")
    alone = after.cameras["cam4"].measures
    assert set(alone) == {f"{name}_{what}" for name in UNCUT for what in ("trained", "decoded")}
    assert all(name not in after.cameras["cam0"].measures for name in alone), "of held-out cameras only"
    assert after.summary.measures["psnr_picture_decoded"] == pytest.approx(alone["psnr_picture_decoded"], abs=1e-3)
    assert after.summary.psnr_picture_fitted_decoded > after.summary.psnr_picture_decoded
