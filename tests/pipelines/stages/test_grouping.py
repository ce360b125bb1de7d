"""Groups that begin where the performer's appearance has changed."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.stages import grouping
from pipelines.stages.grouping import FEWEST, starts_of
from pipelines.takes.groups import cut_at, cut_into_groups


def half(share: float) -> np.ndarray:
    """An image whose upper part is white to a given fraction; `change` between two follows from the areas."""
    picture = np.zeros((20, 20, 4), np.float32)
    picture[: round(20 * share)] = 1
    return picture


def test_cutting_keeps_every_frame_once() -> None:
    frames = tuple(range(10, 40, 3))
    for groups in (cut_at(frames, [0, 4, 5]), cut_into_groups(frames, 4)):
        assert sum((group.frames for group in groups), ()) == frames
        assert [group.first for group in groups] == [frames.index(group.frames[0]) for group in groups]
    assert [len(group.frames) for group in cut_at(frames, [0, 4, 5])] == [4, 1, 5]
    assert [len(group.frames) for group in cut_into_groups(frames, 4)] == [4, 4, 2]


def test_a_performer_who_stands_still_has_the_longest_groups() -> None:
    assert starts_of([[half(0.5)]] * 12, 5, 0.1) == [0, 5, 10]


def test_no_frame_of_a_group_differs_too_much_from_its_keyframe() -> None:
    """Against 0.5, 1.0 has changed by 1/2. With 6 + 6 frames, the keyframe is the first of 1.0."""
    looks = [[half(share)] for share in [0.5] * 6 + [1.0] * 20]
    assert starts_of(looks, 20, 0.6) == [0, 20]
    assert starts_of(looks, 20, 0.4) == [0, 6]
    rows = range(4, 21)
    looks = [[half(row / 20)] for row in rows]
    groups = cut_at(tuple(rows), starts_of(looks, 20, 0.41))
    assert [len(group.frames) for group in groups] == [5, 12]
    for group in groups:
        assert 1 - group.frames[0] / group.keyframe <= 0.41 >= 1 - group.keyframe / group.frames[-1]
    restless = [[half(0.2 if frame % 2 else 1.0)] for frame in range(11)]
    assert np.diff(starts_of(restless, 20, 0.4)).min() >= FEWEST


def test_a_camera_that_does_not_see_him_says_nothing() -> None:
    looks = [[half(0.5), None]] + [[half(1.0), half(0.1)]] * 6
    assert starts_of(looks, 20, 0.6) == [0]
    assert starts_of(looks, 20, 0.4) == [0, 4]


def test_a_take_grouped_by_motion(project: Path, here: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    take = project / "take"
    options = ("--train.group-size", 5, "--train.grouping", "motion", "--until", "train")

    def run(most_change: float) -> list[int]:
        monkeypatch.setattr(grouping, "MOST_CHANGE", most_change)
        here("run", project / "ball.yaml", "--take", take, *options).ok()
        return json.loads((take / "initialize" / "groups.json").read_text())["starts"]

    assert run(0.001) == [0, 4]
    written = (take / "initialize" / "groups.json").stat().st_mtime_ns
    assert len(list((take / "initialize").glob("group_*"))) == 2
    assert run(0.001) == [0, 4]
    assert (take / "initialize" / "groups.json").stat().st_mtime_ns == written, "found once"
    keyframe = (take / "train" / "group_000" / "frame_000000.safetensors").read_bytes()
    assert run(0.9) == [0], "the ball only moves, which does not count"
    assert (take / "train" / "group_000" / "frame_000000.safetensors").read_bytes() == keyframe
    assert not (take / "train" / "group_001").exists()
