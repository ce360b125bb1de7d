from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from v3studio.pipelines.config import presets
from v3studio.pipelines.estimate import rehearsal
from v3studio.pipelines.estimate.estimate import estimate
from v3studio.pipelines.estimate.rehearsal import Measured
from v3studio.pipelines.estimate.work import Work
from v3studio.pipelines.stages import STAGES, stage_named
from v3studio.studio.training import TrainSettings

pytestmark = pytest.mark.long

SETTINGS = TrainSettings(
    keyframe_iterations=1000, densify_until=0, prune_finetune_iterations=100, motion_iterations=50,
    motion_first_iterations=80, finetune_iterations=200, max_splats=7000,
)  # fmt: skip
WORK = Work(
    train_cameras=4, held_out_cameras=2, pixels=40_000, groups=(5, 5, 3), at_once=2, threads=2, points=10_000,
    resolution=100, memory_of_group=1_000_000, train=SETTINGS,
)  # fmt: skip


def train_seconds(work: Work, measured: Measured) -> float:
    (stage,) = (stage for stage in estimate(work, measured, None).stages if stage.stage == "train")
    return stage.seconds


def test_a_stage_without_an_estimate_is_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    new = replace(stage_named("train"), name="tidy")
    monkeypatch.setattr("v3studio.pipelines.estimate.estimate.STAGES", (*STAGES[:4], new, *STAGES[4:]))
    found = estimate(WORK, Measured(baked_frame=2.0), None)
    assert [stage.stage for stage in found.stages] == ["initialize", "set", "train", "tidy", "bake", "evaluate"]
    assert [stage.seconds for stage in found.stages] == [0, None, 0, None, 26, 0]
    assert found.seconds == 26


def test_each_kind_of_step_is_paid_for() -> None:
    # the busiest worker has the groups of 5 and 3 frames: four frames beside a keyframe, and two others
    assert train_seconds(WORK, Measured(motion_step=1.0)) == 4 * 80 + 2 * 50
    assert train_seconds(WORK, Measured(finetune_step=1.0)) == 6 * 200
    assert train_seconds(WORK, Measured(frame=1.0)) == 6
    joint = replace(WORK, train=SETTINGS.replace(joint_iterations=30))
    assert train_seconds(joint, Measured(finetune_step=1.0)) == 6 * 200 + 8 * 30
    # 10,000 splats for 1000 steps and the mean of 10,000 and 7,000 for 100, in two keyframes
    assert train_seconds(WORK, Measured(keyframe_step=1e-4)) == pytest.approx(2 * (1000 + 85))
    # 4 cameras are refined: 75 steps each, twice, after a third as many, then 2 are aligned in 150 steps, twice
    refined = train_seconds(replace(WORK, refines=True), Measured(keyframe_step=1e-4))
    assert refined == pytest.approx(2 * (1000 + 85) + 100 + 2 * (300 + 300))
    # 13 frames of 4 cameras, on two threads
    assert train_seconds(WORK, Measured(view=1.0)) == 26


def test_sizes() -> None:
    train, bake = estimate(WORK, Measured(), 24).stages[2:4]
    assert train.bytes == 13 * 7000 * 4 * (3 + 4 + 3 + 1 + 3 * (SETTINGS.sh_degree + 1) ** 2)
    assert bake.bytes == round(13 * 7000 * 0.96)
    assert estimate(WORK, Measured(), None).stages[3].bytes is None


def test_the_tiny_capture(project: Path, monkeypatch: pytest.MonkeyPatch, here: Callable) -> None:
    monkeypatch.setattr(rehearsal, "SECONDS", 0.2)
    monkeypatch.setattr(rehearsal, "RESOLUTIONS", (16, 20, 28))
    small = {"preview": {"train.keyframe_iterations": 60}, "final": {"train.keyframe_iterations": 6000}}
    monkeypatch.setattr(presets, "PRESETS", small)
    before = sorted(project.rglob("*"))
    found = here("estimate", project / "ball.yaml", "--json", "--presets").ok().result
    assert [stage["stage"] for stage in found["stages"]] == ["initialize", "set", "train", "bake", "evaluate"]
    assert all(stage["seconds"] > 0 for stage in found["stages"] if stage["stage"] != "set")
    assert found["seconds_low"] < found["seconds"] < found["seconds_high"]
    assert found["memory"] > 10e6
    assert found["splats"] == 400
    assert list(found["presets"]) == ["preview", "final"]
    assert 0 < found["presets"]["preview"]["seconds"] < found["presets"]["final"]["seconds"]
    assert sorted(project.rglob("*")) == before


def test_cameras_must_be_known(project: Path, here: Callable) -> None:
    done = here("estimate", project / "ball.yaml", "--set", "capture.rig=null")
    done.fails("the cameras are not known yet", "v3studio calibrate")
