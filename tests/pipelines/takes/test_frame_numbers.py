"""Numbers by which people know frames, and marks that stay with the footage."""

import pytest

from pipelines.takes.frame_numbers import FrameNumbers


@pytest.mark.parametrize(
    ("known", "numbers"),
    [((), [0, 1, 2, 3]), ((60, 61, 62), [60, 61, 62, 63]), ((60, 64), [60, 64, 68, 72]), ((7,), [7, 8, 9, 10])],
)
def test_every_frame_has_a_number_and_every_known_number_is_a_frame(known: tuple[int, ...], numbers: list[int]) -> None:
    frames = FrameNumbers(known)
    assert [frames.number(index) for index in range(4)] == numbers
    for index, number in enumerate(known):
        assert frames.index(number) == index
    if known:
        assert [frames.index(number) for number in (known[0] - 1, known[-1] + 1)] == [None, None]
