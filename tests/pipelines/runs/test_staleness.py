"""What a stage waits for."""

from pathlib import Path

from pipelines.config.loading import load_config
from pipelines.runs.runner import status
from pipelines.takes.take import Take


def test_a_stage_names_all_stages_that_must_run_first(finished: Path) -> None:
    take = Take.open(finished / "take")
    config = load_config(take.config, [("initialize.tolerance", 0.23)])
    found = status(take, config)
    assert found["initialize"].reason.startswith("initialize.tolerance changed")
    assert {name: found[name].reason for name in ("train", "bake", "evaluate")} == {
        "train": "initialize must run first",
        "bake": "initialize, train must run first",
        "evaluate": "initialize, train, bake must run first",
    }
    assert found["calibrate"].needs == ()
    assert all(one.state == "done" for one in status(take, load_config(take.config)).values())


def test_a_stage_that_has_not_run_names_what_it_needs(finished: Path, tmp_path: Path) -> None:
    take = Take.create(tmp_path / "take")
    found = status(take, load_config(finished / "take" / "config.yaml"))
    assert found["calibrate"].reason == "never run"
    assert found["train"].reason == "needs calibrate, initialize"
