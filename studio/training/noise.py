"""Random numbers from a counter: number i of a stream is a hash of i and the seed of the stream.

Unlike those of a `torch.Generator`, they can be drawn in any order, by any thread and on any device, with the same
bits. A step therefore draws one seed on the CPU and uploads nothing. `studio/rasterizer/csrc/random.h` draws the same
numbers.
"""

import torch
from torch import Tensor

_LOW = 0xFFFFFFFF
_BITS = 24


def draw_seed(generator: torch.Generator) -> int:
    """The seed of a stream, 0 to 2^31 - 1."""
    return int(torch.randint(2**31, (1,), generator=generator))


def random_bits(count: int, seed: int, device: torch.device | str = "cpu") -> Tensor:
    """(count,) int64 in 0 to 2^24 - 1, equal on all devices (lowbias32 of Ettinger's hash-prospector)."""
    x = (torch.arange(count, device=device) * 0x9E3779B9 + seed) & _LOW
    x ^= x >> 16
    x = (x * 0x7FEB352D) & _LOW
    x ^= x >> 15
    x = (x * 0x846CA68B) & _LOW
    x ^= x >> 16
    return x >> (32 - _BITS)


def uniform(count: int, seed: int, dtype: torch.dtype, device: torch.device | str = "cpu") -> Tensor:
    """(count,) of a floating dtype, uniform in [0, 1) in steps of 2^-24; arguments as for `random_bits`."""
    return random_bits(count, seed, device).to(dtype) / 2**_BITS
