"""Groups of a run on several machines: kept by stage, and drawn."""

from __future__ import annotations

import numpy as np

from gui.drawing.canvas import Canvas, line_height
from gui.drawing.lanes import draw_lanes
from gui.drawing.palette import ACCENT, BAD, FAIR, GOOD
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
    assert run.lines[-1] == ("warning", "Train, group 1 retried: its worker was lost")
    run.apply(StageStarted(stage="train", reason="forced"))
    assert list(run.lanes) == ["bake"]


def colored(pixels: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((pixels[..., :3] == color).all(-1).sum())


def test_lanes_show_progress_and_those_that_do_not_fit_are_counted():
    def drawn(*lanes: GroupState) -> np.ndarray:
        canvas = Canvas(600, 200)
        draw_lanes(canvas, (10, 10, 580, 180), lanes, 16)
        return canvas.pixels

    half, whole = (
        drawn(lane(0, "running", node="node1", gpu="0", frames_done=done, psnr=27.5, seconds_per_frame=3.0))
        for done in (10, 20)
    )
    assert 1.5 < colored(whole, ACCENT) / colored(half, ACCENT) < 2.1
    told, silent = (
        drawn(lane(0, "retried", attempt=2, message=message), lane(1, "failed"))
        for message in ("its worker was lost", "")
    )
    assert colored(told, FAIR) > 2 * colored(silent, FAIR)
    assert colored(silent, BAD) > 0
    many = drawn(*(lane(group, "done", frames_done=20) for group in range(450)), lane(450, "running", frames_done=20))
    assert colored(many, ACCENT) > 0, "what runs is above what is done"
    assert colored(many, GOOD) > 0
    first = 10 + 2 * (line_height(14) + 8)  # y of the first row
    waiting = drawn(*(lane(group, "queued") for group in range(9)), lane(9, "done", frames_done=20))
    assert colored(waiting[int(first) : int(first) + 20], GOOD) > 0, "what has figures is above what waits"
    fewer = drawn(*(lane(group, "done", frames_done=20) for group in range(300)), lane(450, "running", frames_done=20))
    assert not np.array_equal(many[100:], fewer[100:]), "the last row counts the others"
