"""Counter-based random numbers."""

from v3studio.studio.training.noise import random_bits


def lowbias32(x: int) -> int:
    """The mixer in plain integers."""
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        x = ((x ^ (x >> shift)) * factor) % 2**32
    return x ^ (x >> 16)


def test_the_numbers_are_the_hash_of_index_and_seed() -> None:
    seed = 0xFFFF_FFF7
    expected = [lowbias32((index * 0x9E3779B9 + seed) % 2**32) >> 8 for index in range(50)]
    assert random_bits(50, seed).tolist() == expected
