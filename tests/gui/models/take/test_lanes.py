"""Groups of a run on several machines: kept by stage, and drawn."""

from gui.models.take.run_state import RunState
from pipelines.events import GroupState, StageStarted


def lane(group: int, state: str, stage: str = "train", **own: object) -> GroupState:
    return GroupState(stage=stage, group=group, state=state, frames=20, **own)  # type: ignore[arg-type]


def test_the_latest_state_of_each_group_is_kept_by_stage():
    run = RunState()
    for event in (lane(0, "queued"), lane(1, "queued"), lane(1, "running", node="node1"), lane(0, "done", "bake")):
        run.apply(event)
    run.apply(lane(1, "retried", message="its worker was lost"))
    assert {group: one.state for group, one in run.lanes["train"].items()} == {0: "queued", 1: "retried"}
    assert (run.lines[-1].kind, run.lines[-1].text) == ("warning", "Train, group 1 retried: its worker was lost")
    run.apply(StageStarted(stage="train", reason="forced"))
    assert list(run.lanes) == ["bake"]
