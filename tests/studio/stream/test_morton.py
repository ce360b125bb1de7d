import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from v3studio.studio.stream.morton import MORTON_BITS, interleave, morton_order

coordinate = st.integers(0, (1 << MORTON_BITS) - 1)


def slow_code(cell: tuple[int, int, int]) -> int:
    """Bit by bit, by definition."""
    return sum((cell[axis] >> bit & 1) << (3 * bit + axis) for bit in range(MORTON_BITS) for axis in range(3))


@given(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=20))
def test_interleave_equals_bit_by_bit(cells: list[tuple[int, int, int]]) -> None:
    codes = interleave(np.array(cells, dtype=np.int64))
    assert codes.tolist() == [slow_code(cell) for cell in cells]


def test_order_is_stable_for_equal_points_and_works_for_none() -> None:
    assert morton_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]
    assert morton_order(np.zeros((0, 3))).tolist() == []
