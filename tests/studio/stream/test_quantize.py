import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from v3studio.studio.stream.quantize import LEVELS_8, LEVELS_16, dequantize, join_bytes, quantize, split_bytes

ALL_CODES = np.arange(65536, dtype=np.uint16)


@pytest.mark.parametrize("levels", [LEVELS_8, LEVELS_16])
@given(low=st.floats(-100, 100), width=st.floats(1e-3, 1e3), seed=st.integers(0, 1000))
def test_error_is_at_most_half_a_step(levels: int, low: float, width: float, seed: int) -> None:
    high = low + width
    values = np.random.default_rng(seed).uniform(low, high, 100)
    back = dequantize(quantize(values, low, high, levels), low, high, levels)
    rounding = 3e-7 * max(abs(low), abs(high))  # float32 of the result
    assert np.abs(back - values).max() <= 0.5 * (high - low) / levels + rounding


def test_constant_range() -> None:
    codes = quantize(np.full(7, 3.25), 3.25, 3.25, LEVELS_8)
    assert not codes.any()
    assert dequantize(codes, 3.25, 3.25, LEVELS_8).tolist() == [3.25] * 7


@pytest.mark.parametrize(("mirrored", "lows"), [(False, [0xFE, 0xFE]), (True, [0xFE, 0x01])])
def test_the_low_byte_is_mirrored_where_the_high_byte_is_odd(mirrored: bool, lows: list[int]) -> None:
    """The paper's split, and `low_mirrored` of docs/STREAM.md."""
    high, low = split_bytes(np.array([0x12FE, 0x13FE], dtype=np.uint16), mirrored)
    assert (high.tolist(), low.tolist()) == ([0x12, 0x13], lows)
    assert join_bytes(np.array([2, 3], np.uint8), np.array([7, 7], np.uint8), mirrored=True).tolist() == [519, 1016]


@pytest.mark.parametrize("mirrored", [False, True])
def test_wrong_low_byte_stays_within_its_high_byte(mirrored: bool) -> None:
    high, low = split_bytes(ALL_CODES, mirrored)
    wrong = np.clip(low.astype(int) + 37, 0, 255).astype(np.uint8)
    joined = join_bytes(high, wrong, mirrored)
    assert np.array_equal(joined >> 8, ALL_CODES >> 8)
    assert np.abs(joined.astype(int) - ALL_CODES).max() <= 37
