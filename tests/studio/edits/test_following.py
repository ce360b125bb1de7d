"""Balls that are followed through groups of splats whose motion is known."""

import numpy as np
import pytest
from pydantic import ValidationError

from tests.support.errors import refuses
from v3studio.studio.edits import DetailMark, follow

GROUPS = [range(6), range(6, 11), range(11, 20)]


def place(frame: int) -> np.ndarray:
    """The path of the head, a curve without corners."""
    return np.array([0.05 * frame, 0.2 * np.sin(0.3 * frame), 1.5])


def head_and_body(frame: int) -> np.ndarray:
    """Each group has splats of its own; the body stays."""
    random = np.random.default_rng(next(at for at, group in enumerate(GROUPS) if frame in group))
    head = random.normal(0, 0.05, (200, 3))
    body = random.normal(0, 0.1, (400, 3)) + np.array([0.5, 0, 0.6])
    return np.concatenate([head + place(frame), body])


@pytest.mark.parametrize("frame", [0, 8, 19])
def test_the_ball_stays_on_the_head(frame: int) -> None:
    mark = follow(head_and_body, GROUPS, frame, place(frame), 0.15, 3.0)
    frames = [one for one, _ in mark.path]
    assert frame in frames
    assert {0, 5, 6, 10, 11, 19} <= set(frames)
    # at a border, one frame is guessed from the speed; between points of the path, the ball moves straight
    assert max(np.linalg.norm(mark.at(one) - place(one)) for one in range(20)) < 0.06
    assert (mark.radius, mark.weight) == (0.15, 3.0)


def test_it_is_not_followed_where_nothing_is_left() -> None:
    def gone(frame: int) -> np.ndarray:
        return head_and_body(frame)[200:] if frame >= 6 else head_and_body(frame)

    mark = follow(gone, GROUPS, 2, place(2), 0.15, 3.0)
    assert mark.path[-1][0] == 5
    assert np.allclose(mark.at(15), mark.at(5)), "it stays where it was last"


def test_a_ball_around_nothing_is_refused() -> None:
    with refuses("edits.nothing_there"):
        follow(head_and_body, GROUPS, 3, np.array([9.0, 9.0, 9.0]), 0.1, 2.0)
    with refuses("edits.nothing_there"):
        follow(head_and_body, GROUPS, 20, place(3), 0.1, 2.0)


@pytest.mark.parametrize(
    "values",
    [
        {"radius": 1, "path": ()},
        {"radius": 1, "path": ((2, (0, 0, 0)), (2, (0, 0, 0)))},
        {"radius": 0, "path": ((2, (0, 0, 0)),)},
        {"radius": 1, "weight": 0.5, "path": ((2, (0, 0, 0)),)},
    ],
)
def test_details_that_make_no_sense_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        DetailMark.model_validate(values)
