import filecmp
import json
import math
from pathlib import Path

import cv2
import pytest

from tests.support.errors import refuses
from tests.support.tiny_capture import Here
from v3studio.pipelines.ablation.study import RatePoint, VariantResult, compare
from v3studio.pipelines.ablation.variants import chosen
from v3studio.pipelines.takes.frames.frame_files import read_about

pytestmark = pytest.mark.long


def curve(factor: float, shift: float) -> list[RatePoint]:
    """PSNR linear in the logarithm of the rate."""
    rates = [10.0, 20.0, 40.0, 80.0, 160.0]
    return [
        RatePoint(qp=index, kb_per_frame=rate * factor, psnr_decoded=20 + 3 * math.log2(rate) + shift)
        for index, rate in enumerate(rates)
    ]


def test_distances_between_curves_that_are_known() -> None:
    curves = [curve(1, 0), curve(0.8, 0), curve(1, -0.5), curve(1, 100), curve(1, 0)[:2]]
    entries = compare([VariantResult(name="x", title="x", points=tuple(points)) for points in curves])
    assert "bd_rate_percent" not in entries[0].to_json()
    assert entries[1].bd_rate_percent == pytest.approx(-20, abs=0.01)
    assert entries[1].bd_psnr_db == pytest.approx(-3 * math.log2(0.8), abs=0.002)
    assert entries[2].bd_psnr_db == pytest.approx(-0.5, abs=0.002)
    assert entries[2].bd_rate_percent == pytest.approx(100 * (2 ** (0.5 / 3) - 1), abs=0.02)
    assert entries[3].bd_rate_percent is None, "no quality is reached by both"
    assert entries[4].bd_rate_percent is None, "two points are no curve"
    assert entries[4].to_json()["bd_rate_percent"] is None, "written as null"


def test_the_full_method_is_always_first_and_names_are_checked() -> None:
    assert [variant.name for variant in chosen(["group-20", "no-motion"])] == ["full", "no-motion", "group-20"]
    with refuses("ablation.unknown_variant", value="nothing") as caught:
        chosen(["nothing"])
    assert caught.value.fields["expected"][:2] == ["full", "no-entropy"]


def test_command_shares_keyframes_measures_and_goes_on(project: Path, here: Here) -> None:
    out = project / "ablation"
    arguments = ("ablate", project / "ball.yaml", "--out", out, "--variants", "no-finetune", "--qps", "10,24,34,42")
    shown = here(*arguments, "--set", "capture.frames=:2").ok().stdout
    assert "no fine-tuning" in shown
    results = json.loads((out / "ablation.json").read_text())
    assert [entry["name"] for entry in results["variants"]] == ["full", "no-finetune"]
    assert results["protocol"]["cameras"] == ["cam4"]
    for entry in results["variants"]:
        assert [point["qp"] for point in entry["points"]] == [10, 22, 24, 34, 42], "the default QP is measured too"
        rates = [point["kb_per_frame"] for point in entry["points"]]
        assert rates == sorted(rates, reverse=True)
    # the keyframe, the second of two frames, is the same, byte for byte; the other is not
    groups = [out / "takes" / name / "train" / "group_000" for name in ("full", "no-finetune")]
    frames = [sorted(group.glob("frame_*")) for group in groups]
    assert filecmp.cmp(frames[0][1], frames[1][1], shallow=False)
    assert frames[0][1].stat().st_mtime_ns == frames[1][1].stat().st_mtime_ns, "it was copied, not trained again"
    assert read_about(frames[0][0]).key != read_about(frames[1][0]).key
    assert cv2.imread(str(out / "ablation.png")).shape[1] > 500

    before = {path: path.stat().st_mtime_ns for path in out.rglob("frame_*")}
    again = here(*arguments, "--set", "capture.frames=:2", "--json").ok()
    assert again.result == {"path": str(out), **results}
    assert {path: path.stat().st_mtime_ns for path in out.rglob("frame_*")} == before
    here(*arguments[:-1], "10,x").fails("'10,x' is not", code=2)
