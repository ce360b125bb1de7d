// Images over a background color.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa_namespace.h"
#include "kernels.h"
#include "parallel_for.h"
#include "simd.h"

namespace vs::VS_ISA {

VS_INLINE void over_pixels(const float* __restrict image, const float* __restrict rest, float red, float green,
                           float blue, float* __restrict out, std::int64_t pixels) {
    for (std::int64_t i = 0; i < pixels; i++) {
        out[3 * i] = image[3 * i] + rest[i] * red;
        out[3 * i + 1] = image[3 * i + 1] + rest[i] * green;
        out[3 * i + 2] = image[3 * i + 2] + rest[i] * blue;
    }
}

static void over_color(const OverJob& job, int threads) {
    constexpr std::int64_t BLOCK = 65536;
    auto block = [&](int task) {
        const std::int64_t begin = task * BLOCK, left = job.pixels - begin;
        over_pixels(job.image + 3 * begin, job.rest + begin, job.color[0], job.color[1], job.color[2],
                    job.out + 3 * begin, left < BLOCK ? left : BLOCK);
    };
    parallel_for(int((job.pixels + BLOCK - 1) / BLOCK), threads, block);
}

}  // namespace vs::VS_ISA
