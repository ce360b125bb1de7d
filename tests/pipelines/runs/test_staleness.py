from pathlib import Path

import pytest

from v3studio.pipelines.config.loading import load_config
from v3studio.pipelines.runs.runner import status
from v3studio.pipelines.runs.staleness import differences
from v3studio.pipelines.stages import STAGE_NAMES
from v3studio.pipelines.stages.params import Params
from v3studio.pipelines.takes.take import Take


def test_a_stage_names_all_stages_that_must_run_first(finished: Path) -> None:
    take = Take.open(finished / "take")
    config = load_config(take.config, [("initialize.tolerance", 0.23)])
    found = status(take, config)
    (reason,) = found["initialize"].reasons
    assert (reason.setting, str(reason)) == ("initialize.tolerance", found["initialize"].reason)
    assert found["set"].state == "done"
    later = [name for name in STAGE_NAMES[1:] if name != "set"]
    for number, name in enumerate(later[1:], 1):
        assert found[name].reason == f"{', '.join(later[:number])} must run first"
    assert found["calibrate"].needs == ()
    assert all(one.state == "done" for one in status(take, load_config(take.config)).values())


def test_with_another_metric_the_evaluation_is_stale(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = Take.open(finished / "take")
    monkeypatch.setattr("v3studio.pipelines.stages.evaluate.MEASURES", ("psnr_trained", "psnr_decoded"))
    assert status(take, load_config(take.config))["evaluate"].reason == "the metrics changed"


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        ({"camera file": "a"}, {"camera file": "b"}, ["the camera file changed"]),
        ({"camera file": "a", "shared": 1}, {"footage": "f", **dict.fromkeys("bcdefgh", 1), "shared": 1},
         ["the cameras come from the footage now, not from the camera file"]),
        ({"footage": "f", "a.b": 1}, {"a.b": 2}, ["a.b changed from 1 to 2"]),
    ],
)  # fmt: skip
def test_another_source_of_cameras_is_one_change(before: Params, now: Params, said: list[str]) -> None:
    assert [*map(str, differences(before, now))] == said


def test_a_stage_that_has_not_run_names_what_it_needs(finished: Path, tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    found = status(take, load_config(finished / "take" / "config.yaml"))
    assert found["calibrate"].reason == "not run yet"
    assert found["train"].reason == "needs calibrate, initialize"
