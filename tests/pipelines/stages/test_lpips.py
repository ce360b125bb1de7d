import json
from pathlib import Path
from typing import ClassVar
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from tests.support.errors import refuses
from tests.support.tiny_capture import run_take, settings_in
from v3studio.pipelines.events import StageStarted, Warned
from v3studio.pipelines.reports.tables import print_evaluation
from v3studio.pipelines.stages import evaluate
from v3studio.pipelines.stages.evaluate import loaded_lpips
from v3studio.pipelines.stages.inputs import Inputs
from v3studio.pipelines.stages.reporter import StageReporter
from v3studio.pipelines.takes.take import Take
from v3studio.studio.errors import Message
from v3studio.studio.perceptual import SMALLEST


class StandIn:
    """The mean difference."""

    made: ClassVar[list[tuple[str, str]]] = []
    remark = Message("lpips.other_weights", "These are weights of another kind.")
    protocol = "a stand-in"

    def __init__(self, net: str, device: str) -> None:
        self.made.append((net, device))

    def __call__(self, image: torch.Tensor, target: torch.Tensor, /) -> float:
        assert image.shape == target.shape
        assert min(image.shape[:2]) >= SMALLEST
        return float((image - target).abs().mean())


@pytest.fixture(autouse=True)
def _stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("v3studio.studio.perceptual.Lpips", StandIn)
    monkeypatch.setattr(StandIn, "made", [])
    loaded_lpips.cache_clear()


def test_a_run_on_other_machines_needs_no_gpu_for_it(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The machine of the run reads what the others measured."""
    cluster = Mock()
    cluster.run.side_effect = InterruptedError  # it comes to measuring on other machines
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    inputs = Inputs(Take.open(copied / "take"), settings_in(copied, "evaluate.lpips=alex", "run.device=cuda"))
    with pytest.raises(InterruptedError):
        evaluate.run(inputs, StageReporter("evaluate"), cluster)
    assert StandIn.made == [("alex", "cpu")]
    with refuses("run.no_gpu"):
        evaluate.run(inputs, StageReporter("evaluate"), None)


def test_it_is_measured_as_psnr_is_and_stands_everywhere(
    copied: Path, take: Take, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = json.loads(take.evaluation.read_text())
    events = run_take(copied, "evaluate.lpips=vgg")
    assert [event.stage for event in events if isinstance(event, StageStarted)] == ["evaluate"]
    assert StandIn.made == [("vgg", "cpu")], "loaded once, before anything runs"
    assert [event.message for event in events if isinstance(event, Warned)] == [StandIn.remark.problem]
    after = json.loads(take.evaluation.read_text())
    assert after["protocol"] == {**before["protocol"], "lpips": "a stand-in"}
    for row, plain in zip(after["frames"], before["frames"], strict=True):
        (camera,) = row["cameras"].values()
        assert {"lpips_trained", "lpips_decoded"} <= set(row)
        assert row["lpips_trained"] == pytest.approx(camera["lpips_trained"], abs=6e-5)
        assert [name for name, value in plain.items() if row[name] != value] == ["cameras"]
    for what in ("trained", "decoded"):
        mean = np.mean([row[f"lpips_{what}"] for row in after["frames"]])
        assert mean > 0
        # rows and means are both rounded to four digits
        assert after["summary"][f"lpips_{what}"] == pytest.approx(mean, abs=1.1e-4)
        assert after["cameras"]["cam4"][f"lpips_{what}"] == pytest.approx(mean, abs=1.1e-4)

    report = take.report.read_text()
    assert f"LPIPS decoded<b>{after['summary']['lpips_decoded']:.4f}</b>" in report
    assert report.count("<th>LPIPS trained</th>") == 2
    assert '<td>lpips</td><td class="text">a stand-in</td>' in report
    monkeypatch.setenv("COLUMNS", "200")  # narrow terminals break titles
    print_evaluation(take)
    table = capsys.readouterr().out
    assert any("SSIM" in line and "LPIPS" in line for line in table.splitlines())
    assert "LPIPS: a stand-in" in table
