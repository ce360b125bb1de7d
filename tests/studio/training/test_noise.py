"""Counter-based random numbers."""

import torch

from studio.training.noise import draw_seed, random_bits, uniform


def lowbias32(x: int) -> int:
    """The mixer in plain integers."""
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        x = ((x ^ (x >> shift)) * factor) % 2**32
    return x ^ (x >> 16)


def test_the_numbers_are_the_hash_of_index_and_seed() -> None:
    seed = 0xFFFF_FFF7
    expected = [lowbias32((index * 0x9E3779B9 + seed) % 2**32) >> 8 for index in range(50)]
    assert random_bits(50, seed).tolist() == expected


def test_streams_are_uniform_and_independent() -> None:
    first, second = (uniform(100_000, seed, torch.float64) for seed in (1, 2))
    counts = torch.histc(first, bins=50, min=0, max=1)
    assert float(((counts - 2000) ** 2 / 2000).sum()) < 100, "chi-squared with 49 degrees of freedom"
    for other in (second, first.roll(1)):
        assert abs(float(torch.corrcoef(torch.stack([first, other]))[0, 1])) < 0.02


def test_seeds_follow_the_generator() -> None:
    first, second = (torch.Generator().manual_seed(5) for _ in range(2))
    drawn = [draw_seed(first) for _ in range(200)]
    assert drawn == [draw_seed(second) for _ in range(200)]
    assert len(set(drawn)) == 200
    assert 0 <= min(drawn) < 2**31 / 20
    assert 2**31 - 2**31 / 20 < max(drawn) < 2**31, "all 31 bits are used"
