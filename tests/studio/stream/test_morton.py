import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from studio.stream.morton import MORTON_BITS, interleave, morton_order

coordinate = st.integers(0, (1 << MORTON_BITS) - 1)


def slow_code(x: int, y: int, z: int) -> int:
    """Bit by bit, by definition."""
    code = 0
    for bit in range(MORTON_BITS):
        code |= ((x >> bit) & 1) << (3 * bit)
        code |= ((y >> bit) & 1) << (3 * bit + 1)
        code |= ((z >> bit) & 1) << (3 * bit + 2)
    return code


@given(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=20))
def test_interleave_equals_bit_by_bit(cells):
    codes = interleave(np.array(cells, dtype=np.int64))
    assert codes.tolist() == [slow_code(*cell) for cell in cells]


def test_order_of_a_grid_is_its_z_curve():
    # The 8 corners of a cube, given in reverse: x is the fastest bit, z the slowest.
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    assert morton_order(corners[::-1]).tolist() == [7, 6, 5, 4, 3, 2, 1, 0]


def test_cells_are_cubes():
    # On a long thin box, the long axis alone decides between far points, whatever the short one says.
    points = np.array([[100.0, 0.0, 0.0], [0.0, 0.0, 1.0], [51.0, 0.0, 1.0], [49.0, 0.0, 0.0]])
    assert morton_order(points).tolist() == [1, 3, 2, 0]


def test_order_is_stable_for_equal_points_and_works_for_none():
    assert morton_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]
    assert morton_order(np.zeros((0, 3))).tolist() == []
