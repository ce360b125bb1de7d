// Random numbers from a counter: element i of the stream `seed` is a hash of both, so any thread can draw any element.
// studio/training/noise.py defines the same numbers in PyTorch.
#pragma once

#include <cstdint>

#include "isa_namespace.h"
#include "simd.h"

namespace vs::VS_ISA {

// 24 random bits, for integers and for vectors of them.
template <typename U>
VS_INLINE U random_bits(U index, std::uint32_t seed) {
    U x = index * 0x9E3779B9u + seed;
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x >> 8;
}

}  // namespace vs::VS_ISA
